"""The angles between a SERF gyro's coils from end to end on the simulated bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_runs import run_of, shipped_bench, shipped_plan
from serf_shots import Cell

from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.precession import bad_because
from procedures.serf_nonorthogonality.tone import fit_tone
from station.cli.analysing import analyse_run
from station.record.folder import RunFolder
from station.runner.outcome import Outcome

PROCEDURE = "serf-nonorthogonality"
SEEDS = (0, 1, 2)
SHORT = {
    "shots": "as_published",
    "gyro_was_running": False,
    "nulling": {"rounds": 0},
    "cell_temperature": None,
}
STUCK = {"instrument": "pump_laser", "fault": "stuck-open"}


def run_plan(
    folder: Path,
    seed: int,
    bench: dict[str, Any] | None = None,
    faults: list[dict[str, str]] | None = None,
    **parameters: Any,
) -> tuple[Outcome, dict[str, Any]]:
    """Run the shipped plan; return the truth of the cell beside it."""
    plan_data = shipped_plan(PROCEDURE)
    bench_data = shipped_bench()
    plan_data["parameters"] |= parameters
    bench_data["simulation"] |= {"seed": seed, "faults": faults or []}
    truth: dict[str, Any] = bench_data["simulation"]["serf"]
    truth |= bench or {}
    outcome = run_of(folder, plan_data, bench_data)
    return outcome, truth


@pytest.fixture(scope="module", params=[SEEDS[:1], pytest.param(SEEDS, marks=pytest.mark.campaign)])
def runs(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[Outcome, dict[str, Any]]]:
    """The shipped plan for each seed."""
    folder = tmp_path_factory.mktemp("serf")
    return [run_plan(folder / f"seed-{seed}", seed) for seed in request.param]


def test_the_true_angles_come_back(runs: list[tuple[Outcome, dict[str, Any]]]) -> None:
    errors = []
    for outcome, truth in runs:
        assert outcome.document is not None, outcome.error
        # The gyro was running: step 1 has depolarised its nuclei.
        assert "residual-field-large" not in {flag.code for flag in outcome.document.flags}
        for one in outcome.document.results:
            if one.estimate.name == "nonorthogonality_angle":
                assert one.estimate.axis is not None
                assert one.combined is not None
                true_deg = float(str(truth["coils"]["angles"][one.estimate.axis]).split()[0])
                error = one.estimate.value - true_deg
                errors.append(error / one.combined.standard_uncertainty)
    assert len(errors) == 3 * len(runs)
    assert np.max(np.abs(errors)) < 4
    assert np.mean(np.square(errors)) < 2.5


def test_a_run_records_what_the_papers_formulas_give_on_the_way(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    events = RunFolder(runs[0][0].folder).events_of("published-value")
    recorded = [dict(event.details) for event in events]
    values = [event.pop("value") for event in recorded]
    assert recorded == [
        {"name": "slowing_down_factor", "unit": "1"},
        {"name": "nonorthogonality_angle", "axis": "xy", "unit": "deg"},
    ]
    assert 3.0 < values[0] < 6.5
    assert 80.0 < values[1] < 100.0


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


@pytest.mark.campaign
def test_a_new_analysis_gives_the_same_bytes(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    folder = runs[0][0].folder
    analyse_run(folder, None, compare=False)
    again = (folder / "revisions" / "001" / "results.json").read_bytes()
    assert again == (folder / "results.json").read_bytes()


@pytest.mark.campaign
def test_a_gyro_that_was_running_is_flagged_where_step_1_is_passed_over(tmp_path: Path) -> None:
    outcome, _ = run_plan(tmp_path, 0, gyro_was_running=False)
    assert outcome.document is not None, outcome.error
    assert "residual-field-large" in {flag.code for flag in outcome.document.flags}


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


def test_a_shutter_that_stays_open_once_costs_one_more_shot(tmp_path: Path) -> None:
    outcome, _ = run_plan(tmp_path, 0, faults=[STUCK | {"at": "3 s", "for": "1 s"}], **SHORT)
    assert outcome.document is not None, outcome.error
    (flag,) = (flag for flag in outcome.document.flags if flag.code == "shot-repeated")
    assert "shutter of the pump light stayed open" in flag.message


def test_a_shot_that_pump_light_leaks_into_is_taken_again() -> None:
    plan = shipped_plan(PROCEDURE)["parameters"] | {"full_scale": "2 V"}
    largest_nT = max(SerfParameters.model_validate(plan).field_levels_nT.values())
    good, leaking = Cell().dataset(0).shots, Cell(relaxation=330.0).dataset(0).shots[1]
    fits = [fit_tone(shot.time_s, shot.voltage_V) for shot in good]
    assert bad_because(good[1], fits[1], fits[2:], largest_nT) is None
    fit = fit_tone(leaking.time_s, leaking.voltage_V)
    reason = bad_because(leaking, fit, fits, largest_nT)
    assert reason is not None and "pump light leaked" in reason
