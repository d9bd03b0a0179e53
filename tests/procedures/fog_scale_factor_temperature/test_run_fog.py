"""The scale factor over temperature from end to end on the simulated bench: a short ramp."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.kills import raw_hashes
from campaigns.truths import fog_curve_ppm
from fog_runs import short_run
from places import DATA

from procedures.fog_scale_factor_temperature.from_import import PLACE, REFERENCE_PLACE
from station.cli.analysing import analyse_run
from station.record.folder import RunFolder
from station.record.layout import covered_files, file_hash
from station.runner.outcome import Outcome
from station.runner.resuming import ResumeRequest, resume
from station.safety.acknowledgement import acknowledge

FILES = {PLACE: DATA / "fog-drive" / "drive.csv", REFERENCE_PLACE: DATA / "fog-drive/reference.csv"}
DRIVE = {
    "file": str(FILES[PLACE]),
    "reference": str(FILES[REFERENCE_PLACE]),
    "latitude": "40 deg",
    "initial_heading": "25 deg",
    "initial_pitch": "0 deg",
    "initial_roll": "0 deg",
    "accelerometer_bias": "5 ug",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, dict[str, Any]]:
    """One short run with pairs of turns, and a drive with specific force and a reference."""
    return short_run(tmp_path_factory.mktemp("fog"), seed=3, drive=DRIVE)


@pytest.mark.campaign
def test_the_true_curve_comes_back_at_the_reference_and_at_its_largest(
    run: tuple[Outcome, dict[str, Any]],
) -> None:
    outcome, truth = run
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    found = {(one.estimate.name, one.estimate.axis): one for one in outcome.document.results}
    for axis in "xyz":
        at = found["scale_factor_error", axis]
        assert at.combined is not None
        error_ppm = at.estimate.value - fog_curve_ppm(truth, axis, 26.0)
        # Over ten degrees a straight line may win, which leaves half a ppm of the curve.
        assert abs(error_ppm) < 4 * at.combined.standard_uncertainty + 0.5
        assert at.estimate.extra["model"]["basis"] == "chebyshev"


def test_each_turn_is_a_unit_and_was_verified_by_the_encoder(
    run: tuple[Outcome, dict[str, Any]],
) -> None:
    units = RunFolder(run[0].folder).finished_units()
    turns = {name: details for name, details in units.items() if name.startswith("ramp ")}
    assert len(turns) >= 5 * 3 * 2
    for details in turns.values():
        assert details["turned_deg"] == pytest.approx(details["commanded_deg"], abs=0.01)


def test_the_turns_go_on_until_the_gyros_themselves_are_warm(
    run: tuple[Outcome, dict[str, Any]],
) -> None:
    folder = RunFolder(run[0].folder)
    last = [unit for unit in folder.finished_units() if unit.startswith("ramp ")][-1]
    rows = folder.rows("navigator", last)
    warmest = [rows[f"temperature_{axis}_degC"][-1] for axis in "xyz"]
    assert min(warmest) > 29.0


def test_the_drive_of_the_plan_is_in_the_folder_and_navigated_in_the_results(
    run: tuple[Outcome, dict[str, Any]],
) -> None:
    outcome, _ = run
    for place, given in FILES.items():
        assert (outcome.folder / place).read_bytes() == given.read_bytes()
        assert covered_files(outcome.folder)[place] == file_hash(given)
    results = json.loads((outcome.folder / "results.json").read_text(encoding="utf-8"))
    found = {one["name"]: one for one in results["results"]}
    assert found["heading_error_uncompensated"]["value"] == pytest.approx(-0.151, abs=0.001)
    assert found["position_error_uncompensated"]["value"] == pytest.approx(7.59, abs=0.01)
    assert found["velocity_error_uncompensated"]["value"] == pytest.approx(0.0619, abs=0.001)
    assert found["final_position_error_compensated"]["expanded_uncertainty"] > 0.0
    budget = {line["quantity"]: line for line in found["position_error_compensated"]["budget"]}
    assert budget["accelerometer_bias"]["standard_uncertainty"] == 5.0


def test_a_new_analysis_gives_the_same_bytes(run: tuple[Outcome, dict[str, Any]]) -> None:
    folder = run[0].folder
    analyse_run(folder, None, compare=False)
    again = (folder / "revisions" / "001" / "results.json").read_bytes()
    assert again == (folder / "results.json").read_bytes()


@pytest.mark.campaign
def test_an_interrupted_ramp_goes_on_where_the_gyros_were(tmp_path: Path) -> None:
    silence = {"instrument": "navigator", "fault": "silent", "at": "4550 s", "for": "15 s"}
    ended, truth = short_run(tmp_path, 3, silence)
    # Its own silence, or that of its thermometers for the interlock.
    assert ended.exit_code in (3, 5)
    acknowledge(tmp_path / "bench.yaml")
    before, raw = RunFolder(ended.folder).finished_units(), raw_hashes(ended.folder)
    outcome = resume(ResumeRequest(ended.folder, quiet=True, report=False))
    assert outcome.exit_code == 0, outcome.error
    assert raw.items() <= raw_hashes(ended.folder).items()
    units = RunFolder(ended.folder).finished_units()
    assert {name: units[name] for name in before} == before
    last, (first, second, *_) = list(before)[-1], list(units)[len(before) :]
    # The silence came in the second turn of a pair, which was made again as a whole.
    assert (last, first, second) == ("ramp 4 y 0", "ramp 4 y 2", "ramp 4 y 3")
    assert "ramp 4 y 1" not in units
    drift = units[first]["stands"]["gyro_degC"] - before[last]["stands"]["gyro_degC"]
    assert abs(drift) < 2.0
    assert outcome.document is not None
    for one in outcome.document.results:
        if one.estimate.name == "scale_factor_error" and one.combined is not None:
            true = fog_curve_ppm(truth, str(one.estimate.axis), 26.0)
            assert abs(one.estimate.value - true) < 4 * one.combined.standard_uncertainty + 0.5


def test_the_table_turns_at_the_rate_of_the_plan(run: tuple[Outcome, dict[str, Any]]) -> None:
    units = RunFolder(run[0].folder).finished_units()
    lasted_s = [
        details["rests_s"] - details["before_s"]
        for name, details in units.items()
        if name.startswith("ramp ")
    ]
    # A turn at 30 deg/s, from rest to rest.
    assert all(15.0 < one < 17.0 for one in lasted_s)


def test_a_mean_attitude_does_not_mind_a_heading_that_wraps() -> None:
    from procedures.fog_scale_factor_temperature.from_record import ATTITUDE, mean_attitude_deg

    rows = np.zeros(2, dtype=[(name, float) for name in ATTITUDE])
    rows["heading_deg"] = [359.9, 0.3]
    assert mean_attitude_deg(rows)[0] == pytest.approx(0.1, abs=1e-9)
