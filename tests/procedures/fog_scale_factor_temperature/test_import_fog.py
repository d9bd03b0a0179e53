"""Imported turns over temperature: the examples in tolerance, every fault in one sentence."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fog_records import CURVES, record
from navigated_example import turns_csv
from places import DATA
from simulated_drive import drive_csv, simulated_drive

from procedures.fog_scale_factor_temperature.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.parts import Table
from station.plots import Plot
from station.runner.evaluation import evaluate_dataset

EXAMPLES = sorted(path.name for path in DATA.glob("fog-*"))
PAIRS = "fog-pairs"


def analysed(path: Path, output: Path | None = None) -> dict[str, Any]:
    return analyse_dataset(path, output).to_data()


def by_key(data: dict[str, Any], name: str, axis: str | None) -> dict[str, Any]:
    (found,) = (one for one in data["results"] if (one["name"], one["axis"]) == (name, axis))
    return dict(found)


def copy_of(name: str, folder: Path) -> Path:
    place = folder / name
    shutil.copytree(DATA / name, place)
    return place


def folder_with(
    folder: Path, files: dict[str, str], conditions: str, names: str = "turns: turns.csv"
) -> Path:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "dataset.yaml").write_text(
        "dataset: 1\nprocedure: fog-scale-factor-temperature\n"
        f"files: {{{names}}}\nconditions:\n  attitude_output: heading\n  turn_sense: heading\n"
        + conditions,
        encoding="utf-8",
    )
    return folder


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_come_out_within_their_tolerance(name: str) -> None:
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))
    data = analysed(DATA / name)
    drive = truth.get("drive", [])
    headings = {"heading_error_uncompensated", "heading_error_compensated"} if drive else set()
    assert len(data["results"]) == 6 + len(drive) + len(headings)
    assert data["flags"] == truth["flags"]
    for expected in drive:
        error = by_key(data, expected["name"], None)
        assert abs(error["value"] - expected["value"]) <= expected["tolerance"], error
    for axis, curve in truth["curves"].items():
        one = by_key(data, "scale_factor_error", axis)
        model = one["model"]
        assert (model["basis"], model["unit"]) == ("chebyshev", "degC")
        shape = np.polynomial.Chebyshev(model["coefficients"], model["domain"])
        off = np.abs(shape(np.array(curve["T_degC"])) - curve["delta_ppm"])
        assert (off <= curve["tol_ppm"]).all()
        assert one["order"] == curve["true_order"]
        assert one["rejected_rows"] == curve["outlier_rows"]
        assert one["value"] == pytest.approx(float(shape(20.0)))
        assert one["conditions"] == {"temperature": "20 degC"}
        largest = by_key(data, "largest_scale_factor_error", axis)["value"]
        grid = shape(np.linspace(*model["domain"], 2001))
        assert largest == pytest.approx(np.abs(grid).max(), rel=1e-6)
    assert {one["method"] for one in data["as_published"]} == {"polynomial"}


def test_the_report_shows_curves_residuals_and_compensation() -> None:
    document, findings = evaluate_dataset(read_dataset(DATA / PAIRS))
    parts = draw_parts(findings, document)
    assert {part.title for part in parts if isinstance(part, Plot)} == {
        "Temperatures",
        "Scale-factor error over temperature",
    }
    tables = {part.title: part for part in parts if isinstance(part, Table)}
    assert set(tables) == {
        "Curves",
        "Before and after compensation",
        "Polynomial",
        "Coefficients",
        "Compensation",
    }
    assert all(len(row) == len(one.columns) for one in tables.values() for row in one.rows)


def test_verification_and_drive_bring_their_results_and_enter_no_fit(tmp_path: Path) -> None:
    dataset = record(0, axes=("x", "y", "z"))
    down = record(7, axes=("x", "y", "z"), first_degC=58.0, last_degC=-37.0)
    drive = simulated_drive(
        dict(CURVES), laps=6, temperature_degC=(-25.0, -30.0), sample_interval_s=0.5
    )
    files = {
        "turns.csv": turns_csv(dataset.turns),
        "down.csv": turns_csv(down.turns),
        "drive.csv": drive_csv(drive),
    }
    alone = analysed(folder_with(tmp_path, files, "  gyro_bias: 0.02 deg/h\n"))
    whole = folder_with(
        tmp_path,
        files,
        "  gyro_bias: 0.02 deg/h\n  latitude: 40 deg\n  initial_heading: 25 deg\n",
        "turns: turns.csv, verification: down.csv, drive: drive.csv",
    )
    out = tmp_path / "out"
    data = analysed(whole, out)
    assert data["results"][:6] == alone["results"]
    for axis in "xyz":
        residual = by_key(data, "residual_scale_factor_error", axis)
        assert residual["value"] < 4.0
        assert residual["conditions"]["temperature"] == f"{residual['temperature']:.1f} degC"
        assert residual["rms_before"] > 20.0 * residual["rms_after"]
    before = by_key(data, "heading_error_uncompensated", None)
    after = by_key(data, "heading_error_compensated", None)
    assert before["unit"] == after["unit"] == "deg"
    assert abs(before["value"]) > 50.0 * abs(after["value"])
    assert after["standard_uncertainty"] > 0.0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Vehicle test" in page
    assert "Verification ramp" in page


def test_turns_of_one_sense_have_the_bias_specification_in_their_budget(tmp_path: Path) -> None:
    files = {"turns.csv": turns_csv(record(0, (360,)).turns)}
    data = analysed(folder_with(tmp_path, files, "  gyro_bias: 0.1 deg/h\n"))
    one = by_key(data, "scale_factor_error", "x")
    lines = {line["description"]: line["contribution"] for line in one["budget"]}
    assert lines["gyro bias during the turn"] == pytest.approx(3.6265, rel=1e-3)
    assert one["standard_uncertainty"] > 3.6


def rows_of(name: str) -> list[dict[str, str]]:
    with (DATA / name / "turns.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def rewritten(name: str, folder: Path, rows: list[dict[str, str]], old: str, new: str) -> Path:
    """Return an example with other rows, their columns in the opposite order, and a condition."""
    place = copy_of(name, folder)
    with (place / "turns.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0])[::-1])
        writer.writeheader()
        writer.writerows(rows)
    conditions = (place / "dataset.yaml").read_text(encoding="utf-8")
    assert old in conditions
    (place / "dataset.yaml").write_text(conditions.replace(old, new), encoding="utf-8")
    return place


def coefficients(data: dict[str, Any]) -> list[float]:
    return [
        c
        for axis in "xyz"
        for c in by_key(data, "scale_factor_error", axis)["model"]["coefficients"]
    ]


def test_the_same_turns_told_otherwise_give_the_same_curves(tmp_path: Path) -> None:
    """Headings that fall and are told from -180 deg, without the chamber's temperature."""
    rows = rows_of(PAIRS)
    for row in rows:
        del row["chamber_temperature_degC"]
        for side in ("before", "after"):
            mirrored = -float(row[f"heading_{side}_deg"])
            row[f"heading_{side}_deg"] = f"{(mirrored + 180.0) % 360.0 - 180.0:.4f}"
    other = rewritten(PAIRS, tmp_path, rows, "turn_sense: heading", "turn_sense: about-up")
    assert coefficients(analysed(other)) == pytest.approx(
        coefficients(analysed(DATA / PAIRS)), rel=1e-6
    )


def test_a_full_attitude_need_not_begin_at_north(tmp_path: Path) -> None:
    rows = rows_of("fog-attitude")
    for row in rows:
        for name in ("heading_before_deg", "heading_after_deg"):
            row[name] = f"{(float(row[name]) + 77.0) % 360.0:.6f}"
    other = rewritten("fog-attitude", tmp_path, rows, "soak: 5 h", "soak: 300 min")
    assert coefficients(analysed(other)) == pytest.approx(
        coefficients(analysed(DATA / "fog-attitude")), rel=1e-6
    )
