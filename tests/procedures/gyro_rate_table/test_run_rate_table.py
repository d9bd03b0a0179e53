"""The rate table from end to end on the simulated bench: the world's gyro comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_runs import run_of, shipped_bench, shipped_plan
from pydantic import ValidationError

from procedures.gyro_rate_table import PROCEDURE
from procedures.gyro_rate_table.figures import draw_parts
from procedures.gyro_rate_table.parameters import RateTableParameters
from procedures.gyro_rate_table.steps import need_gyro_follows
from station import registry
from station.errors import ConditionNotReached
from station.files.lookup import BENCHES, find
from station.instruments.bench import read_bench
from station.record.folder import RunFolder
from station.runner.evaluation import evaluate_run
from station.runner.outcome import Outcome

NAME = "gyro-rate-table"
RATES = (20.0, 50.0, 100.0)
SHORT = {
    "rates": [f"{rate:g} deg/s" for rate in RATES],
    "record": "10 s",
    "stand": "10 s",
    "settle": "1 s",
    "switch_ons": 2,
    "warm_up": "60 min",
    "cool": "10 min",
}
PPM = 1e6


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    plan = shipped_plan(NAME)
    plan["parameters"] |= SHORT
    plan["limits"] = {"asymmetry": {"max_abs": "20 ppm"}}
    bench = shipped_bench()
    truth = bench["simulation"]["rate_table"]
    truth |= {"switch_on_scatter": "0 ppm", "asymmetry": "9 ppm", "lean": "5 arcmin"}
    return run_of(tmp_path_factory.mktemp("rate"), plan, bench)


def test_the_run_recovers_the_worlds_gyro(outcome: Outcome) -> None:
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    data = outcome.document.to_data()
    found = {result["name"]: result for result in data["results"]}
    rates = np.array(RATES)
    factors = (1.0 + 18.0 / PPM) * (1.0 + 6.0 / PPM * np.sin(2.0 * np.pi * rates / 70.0))
    scale = float(rates**2 @ factors) / float(rates @ rates)
    truth = {
        "scale_factor": scale,
        "nonlinearity": float(np.max(np.abs(factors / scale - 1.0))) * PPM,
        "asymmetry": 9.0,
    }
    for name, true in truth.items():
        type_a = [line for line in found[name]["budget"] if line["type"] == "A"]
        u = float(np.hypot.reduce([line["contribution"] for line in type_a]))
        assert abs(found[name]["value"] - true) < 4.0 * u, found[name]
    assert abs(found["bias"]["value"] - 0.006) < 0.05
    codes = {flag["code"] for flag in data["flags"]}
    assert not codes & {"part-turns", "misfit", "overload", "gap", "outliers-rejected"}
    kinds = [line["type"] for line in found["scale_factor"]["budget"]]
    assert kinds.count("B") == 2  # pulses need no clock


def test_each_switch_on_is_a_unit_of_its_own(outcome: Outcome) -> None:
    units = RunFolder(outcome.folder).finished_units()
    assert list(units) == ["switch-on 1", "switch-on 2"]
    rates = [record["rate_deg_per_s"] for record in units["switch-on 1"]["records"]]
    assert rates == [0.0, *(sense * rate for rate in RATES for sense in (1.0, -1.0)), 0.0]


def test_the_record_gives_the_same_results_again_and_plots(outcome: Outcome) -> None:
    assert outcome.document is not None
    again, findings = evaluate_run(RunFolder(outcome.folder))
    assert again.to_data()["results"] == outcome.document.to_data()["results"]
    titles = [part.title for part in draw_parts(findings, again)]
    assert titles == [
        "Scale factor by rate",
        "Distance from the line",
        "Residuals of the records",
        "Scale factors",
    ]


def test_a_record_is_of_whole_turns() -> None:
    parameters = RateTableParameters.model_validate(shipped_plan(NAME)["parameters"])
    for turn in parameters.turns:
        turns = abs(turn.rate_deg_per_s) * turn.record_s / 360.0
        assert turns == pytest.approx(round(turns))
        assert turn.record_s >= 40.0


def test_the_outlook_says_what_one_switch_on_leaves_open() -> None:
    plan = {**shipped_plan(NAME)["parameters"], "switch_ons": 1}
    parameters = RateTableParameters.model_validate(plan)
    assert "scale_factor_repeatability" in PROCEDURE.undetermined(parameters)
    lines = PROCEDURE.outlook(parameters)
    assert len(lines) == 2 and "0.38 ppm by how its input axis lies" in lines[0]
    three = RateTableParameters.model_validate(shipped_plan(NAME)["parameters"])
    assert len(PROCEDURE.outlook(three)) == 3


@pytest.mark.parametrize("read", [-10.0, 0.01])
def test_a_gyro_that_does_not_feel_the_turns_ends_the_run(read: float) -> None:
    turn = RateTableParameters.model_validate(shipped_plan(NAME)["parameters"]).turns[1]
    need_gyro_follows(turn, 4.0, 10.0)  # saturated
    with pytest.raises(ConditionNotReached, match="input axis points up"):
        need_gyro_follows(turn, read, 10.0)


def test_a_table_of_one_axis_is_levelled_by_a_person() -> None:
    plan = {**shipped_plan(NAME)["parameters"], "levelled_by": "person"}
    parameters = RateTableParameters.model_validate(plan)
    commands = PROCEDURE.walk(parameters).commands
    words = {command.text for command in commands if hasattr(command, "text")}
    assert "middle and inner axis to 0 deg" not in words


@pytest.mark.parametrize("source", ["imu", "navigator"])
def test_the_run_recovers_each_gyro_of_a_source(source: str, tmp_path: Path) -> None:
    plan = shipped_plan(f"{NAME}-{source}")
    plan["parameters"] |= SHORT | {"axes": ["X", "Z"]}
    if source == "navigator":
        plan["parameters"] |= {"warm_up": "240 min"}
    plan["limits"] = {"asymmetry": {"max_abs": "30 ppm"}}
    outcome = run_of(tmp_path, plan, shipped_bench())
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    units = RunFolder(outcome.folder).finished_units()
    assert list(units) == [f"{axis} switch-on {n}" for axis in "XZ" for n in (1, 2)]
    results = {
        (result["name"], result["axis"]): result for result in outcome.document.to_data()["results"]
    }
    # In a room of 22.5 degC a navigator's own heat decides its scale factor.
    curves = {"X": (4.6, (-12, -158, 194, -66, 90)), "Z": (4.2, (60, -120, -110, -25, -18))}
    errors = {
        axis: np.polyval(own[::-1], (12.5 + heat) / 50.0) for axis, (heat, own) in curves.items()
    }
    asymmetry = {"X": 0.0, "Z": 0.0}
    if source == "imu":
        rates = np.array(RATES)
        swing = float(rates**2 @ np.sin(2.0 * np.pi * rates / 140.0)) / float(rates @ rates)
        errors = {"X": 120.0 + 5.0 * swing, "Z": 210.0 + 20.0 * swing}
        asymmetry = {"X": 12.0, "Z": 5.0}
    for axis, error in errors.items():
        for name, true in (("scale_factor", 1.0 + error / PPM), ("asymmetry", asymmetry[axis])):
            result = results[name, axis]
            assert abs(result["value"] - true) < 3.5 * result["standard_uncertainty"], result
    inputs = [line["quantity"] for line in results["scale_factor", "X"]["budget"]]
    assert ("clock" in str(inputs)) == (source == "imu")


@pytest.mark.parametrize(
    ("source", "change", "what"),
    [
        ("imu", {"axes": ["IA"]}, "give the axes X, Y, Z"),
        ("imu", {"axes": ["X", "X"]}, "an axis stands twice"),
        ("navigator", {"rates": ["10 deg/s", "200 deg/s"]}, "turns 200 deg between two outputs"),
        ("navigator", {"source": "gyro_acquisition"}, "give IA alone"),
    ],
)
def test_a_plan_whose_source_does_not_fit_is_refused(
    source: str, change: dict[str, Any], what: str
) -> None:
    parameters = {**shipped_plan(f"{NAME}-{source}")["parameters"], **change}
    with pytest.raises(ValidationError, match=what):
        RateTableParameters.model_validate(parameters)


def test_a_rate_beyond_the_sensors_range_is_named() -> None:
    rates = {"rates": ["100 deg/s", "500 deg/s"], "sample_interval": "0.3 s"}
    parameters = {**shipped_plan(f"{NAME}-imu")["parameters"], **rates}
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    problems = PROCEDURE.check(RateTableParameters.model_validate(parameters), bench)
    interval, rate = (problem.what for problem in problems)
    assert "a KVH 1775 outputs" in interval
    assert rate == "500 deg/s is not below the gyro's range on this bench, 490 deg/s"
