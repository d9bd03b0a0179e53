"""The conformance tests of what speaks Modbus."""

from __future__ import annotations

from pathlib import Path

import pytest
from conformance_runs import conformance


@pytest.mark.parametrize(
    ("driver", "bench"),
    [
        ("watlow-f4t", "sim"),
        ("watlow-f4", "sim-alternate"),
        ("watlow-output-power", "sim-alternate"),
    ],
)
def test_our_driver_conforms(driver: str, bench: str, tmp_path: Path) -> None:
    done = conformance(tmp_path, driver, bench, "-v")
    assert done.returncode == 0, done.stdout
    role = "test_dut_power" if driver == "watlow-output-power" else "test_thermal_chamber"
    assert role in done.stdout
