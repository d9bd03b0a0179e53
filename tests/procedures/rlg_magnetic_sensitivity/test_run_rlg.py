"""The laser-gyro procedure from end to end on the simulated bench, over real sockets."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_helpers import file_hashes
from rlg_runs import short_run
from scipy.stats import chi2

from station.cli.analysing import analyse_run
from station.record.folder import RunFolder
from station.record.raw import RawIndex
from station.runner.outcome import Outcome

SEEDS = (0, 1, 2)


def hashes(folder: Path) -> dict[str, str]:
    """Return the hashes of what must be the same in every execution of a plan."""
    return file_hashes(folder, "results.json")


@pytest.fixture(scope="module", params=[SEEDS[:2], pytest.param(SEEDS, marks=pytest.mark.campaign)])
def runs(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[Outcome, dict[str, Any]]]:
    parent = tmp_path_factory.mktemp("seeds")
    return [
        short_run(parent / f"seed-{seed}", bench={"simulation/seed": seed})
        for seed in request.param
    ]


def test_the_run_recovers_the_worlds_sensitivities(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    errors = []
    for outcome, truth in runs:
        assert outcome.exit_code == 0, outcome.error
        assert outcome.document is not None
        for result in outcome.document.results:
            assert result.combined is not None
            error = result.estimate.value - truth[result.estimate.axis]
            errors.append(error / result.combined.standard_uncertainty)
    assert len(errors) == 3 * len(runs)
    assert max(np.abs(errors)) < 3, errors
    low, high = chi2.ppf([0.001, 0.999], len(errors)) / len(errors)
    assert low < np.mean(np.square(errors)) < high, errors


def test_every_result_has_a_budget_of_type_a_and_b(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    document = runs[0][0].document
    assert document is not None
    for entry in document.to_data()["results"]:
        kinds = [line["type"] for line in entry["budget"]]
        assert kinds.count("A") == 1
        stated = [line for line in entry["budget"] if line["standard_uncertainty"] is not None]
        # Field, clocks, pulses; three coordinates of probe and gyro, the coil's own three.
        assert [line["type"] for line in stated].count("B") == 3 + 9
        assert all(line["contribution"] == 0.0 for line in entry["budget"] if line not in stated)
        combined = np.sqrt(sum(line["contribution"] ** 2 for line in entry["budget"]))
        assert entry["standard_uncertainty"] == pytest.approx(combined, rel=1e-9)
        assert entry["expanded_uncertainty"] == pytest.approx(
            entry["coverage_factor"] * entry["standard_uncertainty"]
        )


FAR = {"simulation/probe_position": {"x": "40 mm", "y": "-30 mm", "z": "50 mm"}}
QUIET = {
    "instruments/gaussmeter/simulator/gain_error": {"x": "0 %", "y": "0 %", "z": "0 %"},
    "simulation/gyro/angle_random_walk": "0.0000001 deg/sqrt(h)",
    "simulation/gyro/rate_random_walk_in_one_hour": "0.0000001 deg/h",
    "simulation/gyro/dither_residual": "0.00001 arcsec",
    "simulation/gyro/pulse_weight": "0.0000625 arcsec",
    "simulation/gyro/quadratic_sensitivity_per_mT": dict.fromkeys(("IA", "NA", "LA"), "0 deg/h/mT"),
}
NOISE = 1e-4
"""Relative, what noise and the arrivals of readings leave of S in a run of 200 s."""
STATED = "coil_geometry/three_axis/probe"


def test_the_geometry_of_the_coils_brings_the_result_to_the_field_at_the_gyro(
    tmp_path: Path,
) -> None:
    """A probe 71 mm off the centre costs up to 0.34 % of the field; most of that is taken off."""
    off: dict[bool, dict[str, float]] = {}
    for given in (False, True):
        place = {"x": "40.7 mm", "y": "-29.4 mm", "z": "49.5 mm", "uncertainty": "1 mm"}
        stated = {STATED: place} if given else {"coil_geometry": None}
        plan = {"parameters/pulse_weight": "0.0000625 arcsec"}
        outcome, truth = short_run(tmp_path / str(given), plan, FAR | QUIET | stated)
        assert outcome.document is not None, outcome.error
        entries = outcome.document.to_data()["results"]
        off[given] = {e["axis"]: e["value"] / truth[e["axis"]] - 1.0 for e in entries}
        assert all(("field_at_device" in entry) == given for entry in entries)
        names = {line["quantity"] for entry in entries for line in entry["budget"]}
        assert ("probe_x_mm" in names) == given
        rows = {
            entry["axis"]: [
                line["contribution"]
                for line in entry["budget"]
                if line["quantity"].startswith(("probe_", "device_", "coil_"))
            ]
            for entry in entries
        }
    for axis, true in truth.items():
        assert abs(off[True][axis]) < 0.5 * abs(off[False][axis]), (axis, off)
        u = math.hypot(*rows[axis]) / abs(true)
        assert abs(off[True][axis]) < 3.0 * u + NOISE, (axis, off, u)


def test_the_bench_is_safe_and_the_folder_is_complete(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    outcome = runs[0][0]
    assert len(outcome.safe) == 3
    assert len(outcome.outside) == 9
    assert all(one.verified for one in (*outcome.safe, *outcome.outside))
    folder = RunFolder(outcome.folder)
    assert list(folder.finished_units()) == ["warm-up", "IA", "NA", "LA"]
    steps = [event.details["step"] for event in folder.events_of("step-finished")]
    assert steps == ["S1", "S2", "S3.1", "S3.2", "S4", "S5", "S6", "S7", "S8", "S9"]
    manifest = json.loads((outcome.folder / "manifest.json").read_text(encoding="utf-8"))
    for name, value in manifest["files"].items():
        assert hashlib.sha256((outcome.folder / name).read_bytes()).hexdigest() == value
    assert {"plan.yaml", "bench.yaml", "run.json", "events.jsonl", "results.json"} <= set(
        manifest["files"]
    )


def test_the_truth_stands_in_no_file_of_the_run_but_the_bench_copy(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    folder = runs[0][0].folder
    for file in folder.rglob("*.json*"):
        assert "simulation" not in json.dumps(file.read_text(encoding="utf-8")).replace(
            '"simulated"', ""
        ), file


@pytest.mark.campaign
def test_the_same_plan_twice_gives_the_same_raw_files_log_and_results(
    runs: list[tuple[Outcome, dict[str, Any]]], tmp_path: Path
) -> None:
    again, _ = short_run(tmp_path, bench={"simulation/seed": SEEDS[0]})
    assert hashes(again.folder) == hashes(runs[0][0].folder)


def test_another_seed_gives_other_raw_files(runs: list[tuple[Outcome, dict[str, Any]]]) -> None:
    first, second = (hashes(runs[index][0].folder) for index in (0, 1))
    assert first["gyro_acquisition-000.mcap"] != second["gyro_acquisition-000.mcap"]


def test_an_analysis_of_the_folder_gives_the_same_results(
    runs: list[tuple[Outcome, dict[str, Any]]],
) -> None:
    folder = runs[1][0].folder
    stored = (folder / "results.json").read_bytes()
    analyse_run(folder, None, compare=False)
    assert (folder / "results.json").read_bytes() == stored
    assert (folder / "revisions" / "001" / "results.json").read_bytes() == stored


def test_a_raw_file_cut_short_is_read_to_its_last_whole_block(
    runs: list[tuple[Outcome, dict[str, Any]]], tmp_path: Path
) -> None:
    whole = next((runs[-1][0].folder / "raw").glob("gyro_acquisition-*.mcap"))
    rows = np.concatenate(list(RawIndex(whole).blocks("warm-up")))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 20])
    kept = np.concatenate(list(RawIndex(cut).blocks("warm-up")))
    assert 0 < len(kept) < len(rows)
    assert (kept == rows[: len(kept)]).all()


def test_the_field_is_what_the_plan_asks_for(runs: list[tuple[Outcome, dict[str, Any]]]) -> None:
    folder = RunFolder(runs[0][0].folder)
    for axis, coil in {"IA": "x", "NA": "y", "LA": "z"}.items():
        field_mT = folder.rows("gaussmeter", axis)[f"{coil}_T"] * 1e3
        amplitude = (field_mT.max() - field_mT.min()) / 2
        assert amplitude == pytest.approx(1.0, rel=0.01)


def test_a_wrong_serial_number_ends_before_anything_is_energised(tmp_path: Path) -> None:
    outcome, _ = short_run(
        tmp_path,
        bench={
            "instruments/coil_supply.y/simulator/serial": "H999999",
            "instruments/gaussmeter/simulator/serial": "LSA0000",
        },
    )
    assert outcome.exit_code == 3
    assert outcome.error is not None
    assert "coil_supply.y: serial number H999999" in outcome.error
    assert "gaussmeter: serial number LSA0000" in outcome.error
    assert not [one for one in outcome.safe if one.used]


def test_a_gyro_that_does_not_settle_ends_with_a_safe_bench(tmp_path: Path) -> None:
    outcome, _ = short_run(tmp_path, plan={"parameters/warm_up/slope_limit": "0.0001 deg/h^2"})
    assert outcome.exit_code == 3
    assert outcome.error is not None
    assert "did not become steady within 5 min" in outcome.error
    assert all(one.verified for one in outcome.safe)
    assert outcome.document is None


def test_a_result_outside_its_limit_is_exit_code_1(tmp_path: Path) -> None:
    limits = {"magnetic_sensitivity": {"IA": {"max_abs": "0.01 deg/h/mT"}}}
    outcome, _ = short_run(tmp_path, plan={"limits": limits, "parameters/axes": ["IA"]})
    assert outcome.exit_code == 1
    assert outcome.document is not None
    assert outcome.document.verdict == "fail"
