"""The angles between a SERF gyro's coils from end to end on the simulated bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_runs import run_of, shipped_bench, shipped_plan

from procedures.serf_nonorthogonality.nulling import residual_of_pairs_nT
from procedures.serf_nonorthogonality.shots import shots_of
from station.evaluation import conclude_run
from station.record.folder import RunFolder
from station.runner.outcome import Outcome

PROCEDURE = "serf-nonorthogonality"
SEEDS = (0, 1, 2)


def run_plan(
    folder: Path, seed: int, bench: dict[str, Any] | None = None, **parameters: Any
) -> tuple[Outcome, dict[str, Any]]:
    """Run the shipped plan; return the truth of the cell beside it."""
    plan_data = shipped_plan(PROCEDURE)
    bench_data = shipped_bench()
    plan_data["parameters"] |= parameters
    bench_data["simulation"]["seed"] = seed
    truth: dict[str, Any] = bench_data["simulation"]["serf"]
    truth |= bench or {}
    outcome = run_of(folder, plan_data, bench_data)
    return outcome, truth


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Outcome, dict[str, Any]]]:
    """The shipped plan for each seed."""
    folder = tmp_path_factory.mktemp("serf")
    return [run_plan(folder / f"seed-{seed}", seed) for seed in SEEDS]


def test_the_true_angles_come_back(runs: list[tuple[Outcome, dict[str, Any]]]) -> None:
    errors = []
    for outcome, truth in runs:
        assert outcome.document is not None, outcome.error
        for one in outcome.document.results:
            if one.estimate.name == "nonorthogonality_angle":
                assert one.estimate.axis is not None
                assert one.combined is not None
                true_deg = float(str(truth["coils"]["angles"][one.estimate.axis]).split()[0])
                error = one.estimate.value - true_deg
                errors.append(error / one.combined.standard_uncertainty)
    assert len(errors) == 3 * len(SEEDS)
    assert np.max(np.abs(errors)) < 4
    assert np.mean(np.square(errors)) < 2.5


def test_coil_factors_come_back_as_ratios(runs: list[tuple[Outcome, dict[str, Any]]]) -> None:
    gains = {"x": 0.05, "y": -0.04, "z": 0.03}
    for outcome, truth in runs:
        assert outcome.document is not None
        found = {
            one.estimate.axis: one.estimate.value
            for one in outcome.document.results
            if one.estimate.name == "coil_factor"
        }
        true = {
            axis: (1 + float(str(truth["coils"][axis]["error"]).split()[0]) / 100)
            * (1 + gains[axis] / 100)
            for axis in "xyz"
        }
        assert found["x"] == 1.0
        assert found["y"] == pytest.approx(true["y"] / true["x"], abs=5e-4)
        assert found["z"] == pytest.approx(true["z"] / true["x"], abs=5e-4)


def test_the_residual_field_was_nulled_and_what_is_left_is_reported(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    for outcome, _ in runs:
        assert outcome.document is not None
        left = [
            one.estimate.value
            for one in outcome.document.results
            if one.estimate.name == "residual_field"
        ]
        assert np.linalg.norm(np.array(left, dtype=float)) < 1.0
        looks = [
            event.details["field_nT"]
            for event in RunFolder(outcome.folder).events_of("residual-field")
        ]
        assert np.linalg.norm(list(looks[-1].values())) <= 0.5


def test_a_new_analysis_gives_the_same_bytes(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    folder = runs[0][0].folder
    conclude_run(folder, report=False)
    again = (folder / "revisions" / "001" / "results.json").read_bytes()
    assert again == (folder / "results.json").read_bytes()


def test_a_gyro_that_was_running_is_flagged_where_step_1_is_passed_over(tmp_path: Path) -> None:
    nulling = {"tolerance": "0.5 nT", "rounds": 0}
    outcome, _ = run_plan(
        tmp_path, 0, {"gyro_was_running": True}, gyro_was_running=False, nulling=nulling
    )
    assert outcome.document is not None, outcome.error
    assert "residual-field-large" in {flag.code for flag in outcome.document.flags}


def test_a_gyro_that_was_running_is_depolarised_by_step_1(tmp_path: Path) -> None:
    outcome, truth = run_plan(tmp_path, 1, {"gyro_was_running": True}, gyro_was_running=True)
    assert outcome.document is not None, outcome.error
    assert "residual-field-large" not in {flag.code for flag in outcome.document.flags}
    found = {one.estimate.axis: one.estimate.value for one in outcome.document.results[:3]}
    for pair, text in truth["coils"]["angles"].items():
        assert found[pair] == pytest.approx(float(str(text).split()[0]), abs=0.1)


def test_shots_that_stay_saturated_leave_the_angles_undetermined(tmp_path: Path) -> None:
    outcome, _ = run_plan(tmp_path, 0, full_scale="0.05 V", repeats=1, nulling={"rounds": 0})
    assert outcome.exit_code == 6, outcome.error
    assert outcome.document is not None
    assert "shot-repeated" in {flag.code for flag in outcome.document.flags}
    angles = [one for one in outcome.document.results if one.limit is not None]
    assert [one.estimate.value for one in angles] == [None] * 3
    kept = list(RunFolder(outcome.folder).events_of("shot-stays-bad"))
    assert "saturated" in kept[0].details["reason"]
    assert all(one.verified for one in outcome.safe)


def test_the_closed_form_of_pairs_gives_the_residual_field_of_orthogonal_coils() -> None:
    levels = {"x": 50.0, "y": 40.0, "z": 60.0}
    residual = np.array([1.0, -0.6, 0.8])
    pairs = [one for one in shots_of("reversal", levels, "z", "y") if len(one.coils) == 2]
    squares = {one.id: float(np.sum((np.array(one.field_nT) + residual) ** 2)) for one in pairs}
    found = residual_of_pairs_nT(pairs, squares, levels)
    assert list(found.values()) == pytest.approx(residual, rel=1e-3)
