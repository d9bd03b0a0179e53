"""The conformance tests of a driver: ours pass them, and a driver that is broken does not."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conformance_runs import conformance, conformance_of_its_own
from our_drivers import CASES, alone, as_text, bench_data, driver_of, name_of, world_of
from plan_runs import shipped_bench
from quick_yaml import dump_yaml

import station.conformance
from station import registry
from station.conformance import plugin
from station.roles.role import role_of

ASKED = {path.stem for path in Path(station.conformance.__path__[0]).glob("test_*.py")}

BROKEN_DRIVERS = """
from drivers.generic.can_pulse_board import CanPulseBoard
from drivers.kepco.bop import KepcoBop
from station.roles import Block, SafetyReading


class Losing(CanPulseBoard):
    def drain(self):
        block = super().drain()
        kept = {name: values[1:] for name, values in block.columns.items()}
        return Block(kept, block.arrival_time_s[1:])

    def stop(self):
        pass


class Mute(KepcoBop):
    start_sine = None
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
    "takes silence for rest": (
        "    def read_safety(self):\n"
        "        try:\n            return super().read_safety()\n"
        "        except Exception:\n            return SafetyReading(True, 'nothing answers')\n",
        {"test_silence_is_not_rest"},
    ),
    "proves nothing": (
        "    def read_safety(self):\n"
        "        is_off = '1' not in self._line.query('OUTP?')\n"
        "        return SafetyReading(is_off, 'off' if is_off else 'on')\n",
        {"test_an_answer_from_before_is_no_proof_of_rest"},
    ),
    "is switched on at last": (
        "    def last_attempt(self):\n        self._line.last_attempt('OUTP ON')\n",
        {"test_its_last_attempt_brings_it_to_rest"},
    ),
    "is switched on by who asks": (
        "    def identify(self):\n"
        "        self._line.command('OUTP ON')\n        return super().identify()\n",
        {"test_opening_and_asking_it_energises_nothing"},
    ),
    "cannot read as on": (
        "    quantities = {**KepcoBop.quantities, 'output': lambda self: 'off'}\n",
        {"test_it_reads_back_that_it_is_energised"},
    ),
    "says how warm it is in a word": (
        "    quantities = {**KepcoBop.quantities, 'temperature': lambda self: 'warm'}\n",
        {"test_each_quantity_reads_as_its_role_has_it"},
    ),
    "never comes to an end": (
        "    def make_safe(self, deadline_s):\n"
        "        while True:\n            self.place.clock.sleep(1.0)\n",
        {"test_it_can_be_made_safe_again_and_again"},
    ),
    "closes once": (
        "    def close(self):\n        self._line.close()\n        del self._line\n",
        {"test_closing_twice_does_no_harm"},
    ),
}


def forget_packages() -> None:
    for known in (registry.offers, registry.names, registry.load):
        known.cache_clear()


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Install a laboratory's package of broken drivers, each on a bench of its own.

    A folder of metadata beside the package is all that an installation is.
    """
    folder = tmp_path_factory.mktemp("laboratory")
    supplies = {name: f"Broken{n}" for n, name in enumerate(BROKEN_SUPPLIES)}
    code = BROKEN_DRIVERS + "".join(
        f"\n\nclass {supplies[name]}(KepcoBop):\n{body}"
        for name, (body, _) in BROKEN_SUPPLIES.items()
    )
    (folder / "lab_of_broken_drivers.py").write_text(code, encoding="utf-8")
    metadata = folder / "lab-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: lab\nVersion: 1.0\n", encoding="utf-8")
    places = dict.fromkeys(
        (*supplies.values(), "Mute"), ("coil_supply.x", "sim_instruments.kepco.bop:KepcoBop")
    )
    places["Losing"] = (
        "gyro_acquisition",
        "sim_instruments.generic.can_pulse_board:CanPulseBoard",
    )
    drivers = "".join(f"{name} = lab_of_broken_drivers:{name}\n" for name in places)
    simulators = "".join(f"{name} = {simulator}\n" for name, (_, simulator) in places.items())
    (metadata / "entry_points.txt").write_text(
        f"[station.drivers]\n{drivers}\n[station.simulators]\n{simulators}", encoding="utf-8"
    )
    for name, (instrument, _) in places.items():
        bench = alone(shipped_bench(), instrument)
        bench["instruments"][instrument]["driver"] = name
        (folder / f"{name}.yaml").write_text(dump_yaml(bench), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        forget_packages()
        yield folder
    forget_packages()
    sys.modules.pop("lab_of_broken_drivers", None)


@pytest.mark.parametrize("case", CASES)
def test_our_driver_conforms(case: str, tmp_path: Path) -> None:
    name, driver = name_of(case), driver_of(case)
    bench = tmp_path / "bench.yaml"
    bench.write_text(as_text(bench_data(case)), encoding="utf-8")
    where = ("--station-instrument", name, "--station-procedure", world_of(case))
    done = conformance(driver, bench, *where)
    assert done.exit_code == 0, "\n".join(done.failed.values())
    claims = {"make_safe": "test_safety", "drain": "test_sampled_source"}
    owed = {f"test_{role_of(name)}"} & ASKED
    owed |= {
        module
        for verb, module in claims.items()
        if hasattr(registry.load(registry.DRIVERS, driver), verb)
    }
    assert done.passed and done.modules >= {"test_line", *owed}


@pytest.mark.parametrize("fault", BROKEN_SUPPLIES)
def test_a_broken_supply_fails_where_it_is_broken(
    fault: str, laboratory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "never" in fault:
        monkeypatch.setattr(plugin, "LONGEST_S", 2.0)
        monkeypatch.setattr(plugin, "LONGEST_END_S", 0.5)
    name = f"Broken{list(BROKEN_SUPPLIES).index(fault)}"
    _, expected = BROKEN_SUPPLIES[fault]
    done = conformance(name, laboratory / f"{name}.yaml", "-k", " or ".join(sorted(expected)))
    assert done.exit_code == pytest.ExitCode.TESTS_FAILED
    assert expected <= set(done.failed)


def test_a_board_that_loses_samples_and_never_stops_fails(laboratory: Path) -> None:
    done = conformance("Losing", laboratory / "Losing.yaml", "-k", "sampled_source")
    assert done.exit_code == pytest.ExitCode.TESTS_FAILED
    assert set(done.failed) == {"test_nothing_is_lost_in_a_minute", "test_it_is_quiet_once_stopped"}


def test_a_laboratory_runs_them_on_a_driver_of_its_own_package(laboratory: Path) -> None:
    """In a process of their own, as the documentation shows it."""
    wanted = "limits_go_into or beyond_the_rating or closing_twice"
    n = list(BROKEN_SUPPLIES).index("programmes no limit")
    done = conformance_of_its_own(laboratory, f"Broken{n}", f"Broken{n}.yaml", "-k", wanted)
    assert done.returncode == 1, done.stdout + done.stderr
    failed = set(re.findall(r"^FAILED \S+::(\w+)", done.stdout, re.MULTILINE))
    assert failed == {
        "test_the_limits_go_into_the_instrument",
        "test_a_limit_beyond_the_rating_is_refused",
    }
    assert "1 passed" in done.stdout


def test_on_a_real_bench_nothing_is_energised_unless_it_is_asked_for(tmp_path: Path) -> None:
    bench = shipped_bench()
    del bench["simulation"]
    for instrument in bench["instruments"].values():
        instrument.pop("simulator", None)
    path = tmp_path / "real.yaml"
    path.write_text(dump_yaml(bench), encoding="utf-8")
    done = conformance("operator-power", path)
    assert done.exit_code == 0
    left_out = {name for name, why in done.skipped.items() if "give --station-energise" in why}
    assert left_out
    done = conformance("operator-power", path, "--station-energise")
    assert done.exit_code == 0 and left_out <= done.passed


@pytest.mark.parametrize(
    ("driver", "bench", "says"),
    [
        ("kepko", "sim", "no driver is called 'kepko'; --station-driver takes one of"),
        ("lakeshore-f71", "sym", "did you mean"),
        ("lakeshore-f71", "none.yaml", "has no instrument"),
        ("Mute", "Mute.yaml", "the driver 'Mute' cannot be a coil_supply; start_sine() is missing"),
    ],
)
def test_a_wrong_name_or_a_missing_verb_is_reported_before_any_test(
    driver: str, bench: str, says: str, laboratory: Path, capfd: Any
) -> None:
    data = shipped_bench()
    del data["instruments"]["gaussmeter"]
    (laboratory / "none.yaml").write_text(dump_yaml(data), encoding="utf-8")
    path = laboratory / bench
    done = conformance(driver, path if path.is_file() else bench)
    assert done.exit_code == pytest.ExitCode.USAGE_ERROR
    assert not done.modules
    stated = capfd.readouterr().err
    assert says in stated
    assert "Traceback" not in stated
