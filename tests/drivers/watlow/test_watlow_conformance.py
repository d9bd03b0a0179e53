"""The conformance tests of what speaks Modbus."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from conformance_runs import conformance
from fixture import bench_alone


@pytest.mark.parametrize(
    ("driver", "bench"),
    [
        ("watlow-f4t", "sim"),
        ("watlow-f4", "sim-alternate"),
    ],
)
def test_our_driver_conforms(driver: str, bench: str, tmp_path: Path) -> None:
    done = conformance(tmp_path, driver, bench, "-v")
    assert done.returncode == 0, done.stdout
    assert "test_thermal_chamber" in done.stdout


def test_an_output_that_feeds_the_device_conforms(tmp_path: Path) -> None:
    """An F4T whose loop is not wired; behind its first output hangs the supply of the device."""
    entry = {
        "driver": "watlow-output-power",
        "serial": "10423512",
        "settings": {"output": "2.1", "word_order": "high-first"},
        "simulator": {
            "steers": "nothing",
            "word_order": "high-first",
            "sensor_error": "0 K",
            "noise": "0.01 K",
            "set_point_low": "-70 degC",
            "set_point_high": "180 degC",
            "alarms": 4,
            "limit_modules": [],
            "outputs": {"2.1": "dut_power"},
            "inputs": {},
        },
    }
    bench = tmp_path / "bench.yaml"
    bench.write_text(yaml.safe_dump(bench_alone("dut_power", "sim", entry)), "utf-8")
    done = conformance(tmp_path, "watlow-output-power", str(bench), "-v")
    assert done.returncode == 0, done.stdout
    assert "test_dut_power" in done.stdout
