"""The conformance tests of a driver: ours pass them, and a driver that is broken does not."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
import yaml
from conformance_runs import conformance

from station.files.lookup import BENCHES, find

OURS = (
    "kepco-bop-36-12",
    "lakeshore-f71",
    "can-pulse-board",
    "interlock-chain-line",
    "keysight-33522b",
    "operator-power",
)
SECOND = ("kepco-bop-1kw", "lakeshore-425", "serial-pulse-board", "interlock-chain-shared")
ACCELEROMETER = "accelerometer-magnetic-sensitivity"

BROKEN_SUPPLY = """
from drivers.kepco.bop import KepcoBop
from station.roles import SafetyReading


class {name}(KepcoBop):
{body}
"""

BROKEN_SUPPLIES = {
    "cuts the current off": (
        "    def make_safe(self, deadline_s):\n"
        "        self._line.command('CURR:MODE FIX;:CURR 0')\n"
        "        self._line.command('OUTP OFF')\n",
        {"test_it_comes_down_no_faster_than_its_slew_limit"},
    ),
    "believes that it is safe": (
        "    def make_safe(self, deadline_s):\n        pass\n"
        "    def read_safety(self):\n        return SafetyReading(True, 'off')\n",
        {
            "test_it_comes_to_rest_from_any_state",
            "test_the_sine_runs_with_its_amplitude_and_frequency",
        },
    ),
    "programmes no limit": (
        "    def programme_limits(self):\n        pass\n",
        {"test_the_limits_go_into_the_instrument", "test_a_limit_beyond_the_rating_is_refused"},
    ),
    "takes its time": (
        "    def make_safe(self, deadline_s):\n"
        "        self.place.clock.sleep_until(deadline_s + 1)\n"
        "        super().make_safe(deadline_s + 60)\n",
        {
            "test_it_comes_to_rest_from_any_state",
            "test_it_reads_back_that_it_is_at_rest",
        },
    ),
    "half the amplitude": (
        "    def load_sine(self, frequency_Hz, amplitude_A):\n"
        "        return super().load_sine(frequency_Hz, amplitude_A / 2)\n",
        {
            "test_the_sine_runs_with_its_amplitude_and_frequency",
            "test_a_sine_beyond_the_limit_is_refused",
        },
    ),
    "knows anybody": (
        "    def identify(self):\n"
        "        answer = self._line.query('*IDN?').split(',')\n"
        "        return __import__('station.roles').roles.Identity('', answer[0], '1', '')\n",
        {"test_it_says_who_is_there", "test_nonsense_is_reported_clearly"},
    ),
    "lets errors through": (
        "    def __init__(self, place):\n"
        "        try:\n            super().__init__(place)\n            self.identify()\n"
        "        except Exception as error:\n            raise RuntimeError('no') from error\n",
        {"test_a_closed_port_is_reported_clearly", "test_silence_is_reported_clearly_and_in_time"},
    ),
    "closes once": (
        "    def close(self):\n        self._line.close()\n        del self._line\n",
        {"test_closing_twice_does_no_harm"},
    ),
}

LOSING_BOARD = """
from drivers.generic.can_pulse_board import CanPulseBoard
from station.roles import Block


class Losing(CanPulseBoard):
    def drain(self):
        block = super().drain()
        kept = {name: values[1:] for name, values in block.columns.items()}
        return Block(kept, block.arrival_time_s[1:])

    def stop(self):
        pass
"""


def failed(done: subprocess.CompletedProcess[str]) -> set[str]:
    return set(re.findall(r"^FAILED \S+::(\w+)", done.stdout, re.MULTILINE))


def lab_package(folder: Path, code: str, name: str, replaced: str) -> str:
    """Lay out a laboratory's package with one driver, and a bench that uses it; return the bench.

    A folder of metadata beside the package is all that an installation is.
    """
    (folder / "lab").mkdir()
    (folder / "lab" / "__init__.py").write_text(code, encoding="utf-8")
    metadata = folder / "lab-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: lab\nVersion: 1.0\n", encoding="utf-8")
    simulators = {
        "kepco-bop-36-12": "sim_instruments.kepco.bop:KepcoBop",
        "can-pulse-board": "sim_instruments.generic.can_pulse_board:CanPulseBoard",
    }
    (metadata / "entry_points.txt").write_text(
        f"[station.drivers]\nlab-driver = lab:{name}\n\n"
        f"[station.simulators]\nlab-driver = {simulators[replaced]}\n",
        encoding="utf-8",
    )
    bench = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    for instrument in bench["instruments"].values():
        if instrument["driver"] == replaced:
            instrument["driver"] = "lab-driver"
    (folder / "lab.yaml").write_text(yaml.safe_dump(bench), encoding="utf-8")
    return "lab.yaml"


@pytest.mark.parametrize("driver", OURS)
def test_our_driver_conforms(driver: str, tmp_path: Path) -> None:
    done = conformance(tmp_path, driver)
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


@pytest.mark.parametrize("driver", SECOND)
def test_our_second_driver_conforms(driver: str, tmp_path: Path) -> None:
    done = conformance(tmp_path, driver, "sim-alternate")
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("driver", ["keysight-34465a", "keysight-34465a-pt100"])
def test_our_meter_conforms_at_the_accelerometer(driver: str, tmp_path: Path) -> None:
    done = conformance(tmp_path, driver, "sim", "--station-procedure", ACCELEROMETER)
    assert done.returncode == 0, done.stdout
    assert "test_multimeter" in done.stdout


@pytest.mark.parametrize("fault", BROKEN_SUPPLIES)
def test_a_broken_supply_fails_where_it_is_broken(fault: str, tmp_path: Path) -> None:
    body, expected = BROKEN_SUPPLIES[fault]
    code = BROKEN_SUPPLY.format(name="Broken", body=body)
    bench = lab_package(tmp_path, code, "Broken", "kepco-bop-36-12")
    done = conformance(tmp_path, "lab-driver", bench, "-k", " or ".join(sorted(expected)))
    assert done.returncode == 1, done.stdout + done.stderr
    assert expected <= failed(done), done.stdout


def test_a_supply_that_lacks_a_verb_is_refused_by_name(tmp_path: Path) -> None:
    code = BROKEN_SUPPLY.format(name="Broken", body="    start_sine = None\n")
    bench = lab_package(tmp_path, code, "Broken", "kepco-bop-36-12")
    done = conformance(tmp_path, "lab-driver", bench)
    assert done.returncode == 4
    said = "the driver 'lab-driver' cannot be a coil_supply; start_sine() is missing"
    assert said in done.stdout + done.stderr


def test_a_board_that_loses_samples_and_never_stops_fails(tmp_path: Path) -> None:
    bench = lab_package(tmp_path, LOSING_BOARD, "Losing", "can-pulse-board")
    done = conformance(tmp_path, "lab-driver", bench, "-k", "sampled_source")
    assert done.returncode == 1, done.stdout + done.stderr
    assert failed(done) == {"test_nothing_is_lost_in_a_minute", "test_it_is_quiet_once_stopped"}


def test_on_a_real_bench_nothing_is_energised_unless_it_is_asked_for(tmp_path: Path) -> None:
    bench = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    del bench["simulation"]
    for instrument in bench["instruments"].values():
        instrument.pop("simulator", None)
    (tmp_path / "real.yaml").write_text(yaml.safe_dump(bench), encoding="utf-8")
    done = conformance(tmp_path, "operator-power", "real.yaml", "-rs")
    assert done.returncode == 0, done.stdout
    assert "give --station-energise to allow it" in done.stdout
    done = conformance(tmp_path, "operator-power", "real.yaml", "-rs", "--station-energise")
    assert "give --station-energise" not in done.stdout


@pytest.mark.parametrize(
    ("driver", "bench", "says"),
    [
        ("kepko", "sim", "no driver is called 'kepko'; --station-driver takes one of"),
        ("lakeshore-f71", "sym", "did you mean"),
        ("lakeshore-f71", "none.yaml", "has no instrument"),
    ],
)
def test_a_wrong_name_is_told_before_any_test(
    driver: str, bench: str, says: str, tmp_path: Path
) -> None:
    data = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    del data["instruments"]["gaussmeter"]
    (tmp_path / "none.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    done = conformance(tmp_path, driver, bench)
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert says in done.stderr
    assert "Traceback" not in done.stderr
