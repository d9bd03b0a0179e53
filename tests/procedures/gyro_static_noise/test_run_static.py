"""The gyro at rest from end to end on the simulated bench."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from plan_runs import run_of, shipped_bench, shipped_plan
from pydantic import ValidationError

from procedures.gyro_static_noise import PROCEDURE
from procedures.gyro_static_noise.parameters import StaticParameters
from station.record.folder import RunFolder
from station.runner.evaluation import evaluate_run
from station.runner.outcome import Outcome

NAME = "gyro-static-noise"
SHORT = {"record": "15 min", "repeats": 2, "repeat_record": "1 min", "cool": "10 min"}


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    plan = shipped_plan(NAME)
    plan["parameters"] |= {**SHORT, "warm_up": "60 min"}
    plan["limits"] = {"angle_random_walk": {"max": "0.002 deg/sqrt(h)"}}
    return run_of(tmp_path_factory.mktemp("static"), plan, shipped_bench())


def test_the_run_recovers_the_worlds_noise(outcome: Outcome) -> None:
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    data = outcome.document.to_data()
    found = {one["name"]: one for one in data["results"]}
    # The rounding of 0.0625 arcsec and what is left of the dither, 0.05 arcsec.
    q = (0.0625**2 / 12.0 + 0.05**2) ** 0.5
    truth = {"quantisation_noise": q, "angle_random_walk": 0.001}
    for name, true in truth.items():
        error = abs(found[name]["value"] - true)
        assert error < 3.5 * found[name]["standard_uncertainty"], found[name]
    assert abs(found["bias"]["value"] - 0.006) < 0.05
    kinds = [line["type"] for line in found["bias"]["budget"]]
    assert kinds.count("B") >= 3
    assert found["bias_repeatability"]["value"] < 0.03


def test_each_switch_on_is_a_unit_of_its_own(outcome: Outcome) -> None:
    folder = RunFolder(outcome.folder)
    assert list(folder.finished_units()) == [f"switch-on {n}" for n in (1, 2, 3)]


def test_the_record_gives_the_same_results_again(outcome: Outcome) -> None:
    assert outcome.document is not None
    again, _ = evaluate_run(RunFolder(outcome.folder))
    assert again.to_data()["results"] == outcome.document.to_data()["results"]


def test_the_outlook_says_what_one_switch_on_leaves_open() -> None:
    parameters = StaticParameters.model_validate({**shipped_plan(NAME)["parameters"], "repeats": 0})
    assert "bias_repeatability" in PROCEDURE.undetermined(parameters)
    assert any("Allan deviation to 1600 s" in line for line in PROCEDURE.outlook(parameters))


UPRIGHT = {
    "X": {"azimuth": "0 deg", "elevation": "90 deg"},
    "Z": {"azimuth": "0 deg", "elevation": "-90 deg"},
}


@pytest.fixture(scope="module")
def run_of_source(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Outcome]:
    @cache
    def run(source: str) -> Outcome:
        plan = shipped_plan(f"{NAME}-{source}")
        plan["parameters"] |= SHORT
        if source == "navigator":
            plan["parameters"] |= {"input_axis": UPRIGHT, "repeats": 1}
        plan["limits"] = {"angle_random_walk": {"max": "0.03 deg/sqrt(h)"}}
        return run_of(tmp_path_factory.mktemp(source), plan, shipped_bench())

    return run


def results_of(outcome: Outcome) -> dict[tuple[str, str], dict[str, Any]]:
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    return {(one["name"], one["axis"]): one for one in outcome.document.to_data()["results"]}


def test_a_sensor_at_rest_gives_the_noise_and_bias_of_its_three_gyros(
    run_of_source: Callable[[str], Outcome],
) -> None:
    outcome = run_of_source("imu")
    results = results_of(outcome)
    # The sensor keeps its settings; they are put back before it is switched off.
    events = (outcome.folder / "events.jsonl").read_text("utf-8")
    assert '"instrument-settings"' in events and '"settings-stay"' not in events
    for axis, bias in {"X": 0.42, "Y": -0.31, "Z": 0.18}.items():
        for name, true in (("angle_random_walk", 0.012), ("bias", bias)):
            result = results[name, axis]
            assert abs(result["value"] - true) < 3.5 * result["standard_uncertainty"], result


def test_a_navigator_shows_each_gyro_while_it_is_upright(
    run_of_source: Callable[[str], Outcome],
) -> None:
    outcome = run_of_source("navigator")
    results = results_of(outcome)
    assert list(RunFolder(outcome.folder).finished_units()) == [
        f"{axis} switch-on {n}" for axis in UPRIGHT for n in (1, 2)
    ]
    # Warm in a room of 22.5 degC: their own heat is in the bias, and its walk over the hours.
    for axis, bias in {"X": 0.05 + 0.005 * (12.5 + 4.6), "Z": 0.06 + 0.008 * (12.5 + 4.2)}.items():
        for name, true in (("angle_random_walk", 0.002), ("bias", bias)):
            result = results[name, axis]
            assert abs(result["value"] - true) < 3.5 * result["standard_uncertainty"], result
        assert "elevation" not in str(results["bias", axis]["budget"])


@pytest.mark.parametrize(
    ("source", "change", "what"),
    [
        ("imu", {"pulse_weight": "0.4 arcsec"}, "the sensor outputs rates"),
        ("imu", {"input_axis": {"IA": UPRIGHT["Z"]}}, "give the axes X, Y, Z"),
        ("navigator", {"pulse_weight": None}, "needs the step of its angles"),
        ("navigator", {"sample_interval": "2 s"}, "a navigator outputs every 0.1 s to 1 s"),
        (
            "navigator",
            {"input_axis": {"X": {"azimuth": "0 deg", "elevation": "0 deg"}}},
            "the gyro along the vertical alone",
        ),
        ("navigator", {"source": "gyro_acquisition"}, "give IA alone"),
    ],
)
def test_a_plan_whose_source_does_not_fit_is_refused(
    source: str, change: dict[str, Any], what: str
) -> None:
    parameters = {**shipped_plan(f"{NAME}-{source}")["parameters"], **change}
    with pytest.raises(ValidationError, match=what):
        StaticParameters.model_validate(parameters)


def test_a_sensor_that_repeats_one_output_ends_the_run(tmp_path: Path) -> None:
    plan, bench = shipped_plan(f"{NAME}-imu"), shipped_bench()
    plan["parameters"] |= {**SHORT, "warm_up": "1 min"}
    plan["limits"] = {}
    bench["simulation"]["faults"] = [{"instrument": "imu", "fault": "frozen", "at": "5 min"}]
    outcome = run_of(tmp_path, plan, bench)
    assert outcome.exit_code == 3
    assert "hold the same six rates and specific forces" in (outcome.error or "")
    assert not RunFolder(outcome.folder).finished_units()
