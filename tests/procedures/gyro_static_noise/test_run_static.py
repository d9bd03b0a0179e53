"""The gyro at rest from end to end on the simulated bench."""

from __future__ import annotations

import pytest
from plan_runs import run_of, shipped_bench, shipped_plan

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
