"""The bias over temperature from end to end on the simulated bench: the world's gyro comes out."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from campaigns.truths import bias_temperature_truth
from places import ROOT
from plan_runs import run_of, shipped_bench, shipped_plan
from quick_yaml import dump_yaml

from procedures.gyro_bias_temperature.parameters import BiasTemperatureParameters
from station import registry
from station.cli.validating import read_bench_named, read_plan_for
from station.errors import InputError
from station.files.faults import FaultList
from station.instruments.bench import read_bench
from station.method.motion import TemperatureRamp
from station.method.run import EarlierProgress
from station.procedure import procedure_of
from station.record.folder import RunFolder
from station.runner.evaluation import evaluate_run
from station.runner.outcome import Outcome
from station.runner.resuming import ResumeRequest, resume

NAME = "gyro-bias-temperature"
SOAKS = (-40.0, -20.0, 0.0, 20.0, 40.0, 60.0, 40.0, 20.0, 22.0)
COOLER = {"soaks": ["0 degC", "20 degC", "40 degC"], "soak": "1 h", "warm_up": "1 h"}
TO_40_DEGC = (0.0, 20.0, 40.0, 22.0)
WITHIN_U = 3.5


def one_switch_on(seed: int = 1) -> dict[str, Any]:
    """Return the simulated bench, each switch-on of whose gyro has the same bias."""
    bench = shipped_bench()
    bench["simulation"]["seed"] = seed
    bench["simulation"]["gyro"]["switch_on_scatter"] = "0 deg/h"
    return bench


def off_the_truth(outcome: Outcome, bench: dict[str, Any], soaks: tuple[float, ...]) -> list[str]:
    """Return the results that are too far from what the world knows, and those that are null."""
    assert outcome.document is not None, outcome.error
    off = []
    for result in outcome.document.to_data()["results"]:
        if result["value"] is None:
            off.append(f"{result['name']} is null")
            continue
        true = bias_temperature_truth(bench, result, soaks)
        assert true is not None
        error = abs(result["value"] - true) / result["standard_uncertainty"]
        if error > WITHIN_U:
            off.append(f"{result['name']} {result['value']}, true {true}: {error:.1f} u")
    return off


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    plan = shipped_plan(NAME)
    plan["parameters"] |= COOLER
    return run_of(tmp_path_factory.mktemp("bias-temperature"), plan, one_switch_on())


def test_the_run_recovers_the_worlds_gyro(outcome: Outcome) -> None:
    assert outcome.exit_code == 0, outcome.error
    assert off_the_truth(outcome, one_switch_on(), TO_40_DEGC) == []
    assert outcome.document is not None
    data = outcome.document.to_data()
    assert {flag["code"] for flag in data["flags"]} == {"simulated"}
    bias = next(result for result in data["results"] if result["name"] == "bias")
    inputs = {line["quantity"] for line in bias["budget"] if line["type"] == "B"}
    assert inputs >= {"elevation_IA", "latitude", "thermometer_degC", "pulse_weight", "clock"}


def test_each_ramp_and_each_soak_is_a_unit_of_its_own(outcome: Outcome) -> None:
    units = RunFolder(outcome.folder).finished_units()
    legs = [f"{phase} {number}" for number in range(1, 5) for phase in ("ramp", "soak")]
    assert list(units) == legs
    assert units["ramp 4"]["set_point_degC"] == 22.0


def test_the_record_gives_the_same_results_again(outcome: Outcome) -> None:
    assert outcome.document is not None
    again, _ = evaluate_run(RunFolder(outcome.folder))
    assert again.to_data()["results"] == outcome.document.to_data()["results"]


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_shipped_plan_recovers_the_worlds_gyro(seed: int, tmp_path: Path) -> None:
    outcome = run_of(tmp_path, shipped_plan(NAME), one_switch_on(seed))
    assert off_the_truth(outcome, one_switch_on(seed), SOAKS) == []


KILLED = """
import os, sys
from pathlib import Path
from procedures.gyro_bias_temperature.steps import Climate
from plan_runs import run_of
from quick_yaml import load_yaml

folder, during = Path(sys.argv[1]), sys.argv[2]
look, looks = Climate._look, []

def until_the_middle(climate):
    look(climate)
    looks.append(climate.unit)
    if looks.count(during) == 70:
        os.kill(os.getpid(), 9)

Climate._look = until_the_middle
plan, bench = (load_yaml((folder / name).read_text("utf-8")) for name in ("plan", "bench"))
run_of(folder, plan, bench)
"""


@pytest.mark.parametrize("during", ["ramp 3", pytest.param("soak 2", marks=pytest.mark.campaign)])
def test_a_run_that_is_killed_in_the_middle_of_a_ramp_or_a_soak_goes_on(
    during: str, tmp_path: Path
) -> None:
    plan, bench = shipped_plan(NAME), shipped_bench()
    bench["simulation"]["gyro"]["switch_on_scatter"] = "0.3 deg/h"
    plan["parameters"] |= COOLER
    for name, data in (("plan", plan), ("bench", bench)):
        (tmp_path / name).write_text(dump_yaml(data), encoding="utf-8")
    command = [sys.executable, "-c", KILLED, tmp_path, during]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests" / "support")}
    killed = subprocess.run(command, env=environment, check=False, capture_output=True)
    assert killed.returncode == -9, killed.stderr
    (folder,) = (tmp_path / "runs").glob("[!.]*")
    assert during not in RunFolder(folder).finished_units()
    resumed = resume(ResumeRequest(folder, quiet=True, report=False))
    assert resumed.exit_code == 0, resumed.error
    units = RunFolder(folder).finished_units()
    assert list(units).index("return 1") + 1 == list(units).index(during)
    assert {details["switch_on"] for details in units.values()} == {1, 2}
    assert resumed.document is not None
    data = resumed.document.to_data()
    assert {flag["code"] for flag in data["flags"]} >= {"resumed", "gap", "simulated"}
    # Another switch-on has another bias, ten u off; all else is as it was.
    off = off_the_truth(resumed, bench, TO_40_DEGC)
    assert [one for one in off if not one.startswith("bias ")] == []


def test_what_is_left_of_a_run_begins_with_the_way_back() -> None:
    procedure = procedure_of(NAME)
    parameters = BiasTemperatureParameters.model_validate(shipped_plan(NAME)["parameters"])
    done = {"switch_on": 1}
    past = EarlierProgress(dict.fromkeys(("ramp 1", "soak 1", "ramp 2", "soak 2"), done))
    left = procedure.walk(parameters, past)
    ramps = [command for command in left.commands if isinstance(command, TemperatureRamp)]
    assert [ramp.temperature_degC for ramp in ramps[:2]] == [-20.0, 0.0]
    assert ramps[0].rate_degC_per_h == 30.0
    whole = procedure.walk(parameters)
    assert whole.duration().expected_s / 3600.0 == pytest.approx(25.0, abs=0.5)


def test_air_that_does_not_come_to_the_soak_ends_the_run(tmp_path: Path) -> None:
    plan, bench = shipped_plan(NAME), shipped_bench()
    plan["parameters"] |= COOLER | {"soak": "10 min", "warm_up": "1 min"}
    fault = {"instrument": "thermal_chamber", "fault": "heater-broken", "at": "2 h"}
    bench["simulation"]["faults"] = [fault]
    ended = run_of(tmp_path, plan, bench)
    assert ended.exit_code == 3
    assert "look at its door, its alarms and its load" in str(ended.error)


def test_a_pulse_board_that_stands_still_ends_the_run(tmp_path: Path) -> None:
    plan, bench = shipped_plan(NAME), shipped_bench()
    plan["parameters"] |= COOLER
    bench["simulation"]["faults"] = [
        {"instrument": "gyro_acquisition", "fault": "frozen", "at": "2 h"}
    ]
    ended = run_of(tmp_path, plan, bench)
    assert ended.exit_code == 3 and ended.error is not None
    assert ended.error.startswith("gyro_acquisition: record ")
    assert "samples in a row hold the same count" in ended.error


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("parameters.soaks=[20 degC, 20 degC]", "two soaks at 20 degC follow one another"),
        ("parameters.reference_temperature=80 degC", "lies outside the soaks"),
        ("parameters.row_interval=2 s", "a row is the mean of at least 5 samples"),
        ("parameters.soaks=[-60 degC, 20 degC]", "that the bench allows for thermal_chamber"),
        ("parameters.ramp_up=5 degC/min", "that the bench allows for thermal_chamber"),
    ],
)
def test_a_plan_that_cannot_be_run_is_refused(change: str, sentence: str) -> None:
    with pytest.raises((FaultList, InputError), match=sentence):
        read_plan_for(NAME, read_bench_named("sim"), (change,))


def test_a_bench_without_a_chamber_refuses_the_plan(tmp_path: Path) -> None:
    data = shipped_bench()
    del data["instruments"]["thermal_chamber"]
    data["interlocks"] = [
        one for one in data["interlocks"] if one["when"]["instrument"] != "thermal_chamber"
    ]
    data["safe_state"] = [one for one in data["safe_state"] if one["role"] != "thermal_chamber"]
    (tmp_path / "bench.yaml").write_text(dump_yaml(data), encoding="utf-8")
    bench = read_bench(tmp_path / "bench.yaml", registry.names(registry.DRIVERS))
    with pytest.raises((FaultList, InputError), match="thermal_chamber"):
        read_plan_for(NAME, bench, ())
