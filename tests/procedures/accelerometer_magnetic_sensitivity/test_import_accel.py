"""Imported accelerometer datasets: the examples within tolerance, and their report."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from places import DATA

from procedures.accelerometer_magnetic_sensitivity.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.parts import Table
from station.plots import Plot
from station.results import ResultDocument
from station.runner.evaluation import evaluate_dataset

EXAMPLES = sorted(path.name for path in DATA.glob("accelerometer-*-plane*"))
ONE, THREE = "accelerometer-one-plane", "accelerometer-three-planes"


def analysed(path: Path) -> ResultDocument:
    return analyse_dataset(path, None)


def copy_of(name: str, folder: Path) -> Path:
    place = folder / name
    shutil.copytree(DATA / name, place)
    return place


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_come_out_within_their_tolerance(name: str) -> None:
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))
    data = analysed(DATA / name).to_data()
    found = {one["name"]: one for one in data["results"]}
    assert len(found) == 13
    for expected in truth["expected"]:
        one = found[expected["name"]]
        assert one["axis"] is None
        assert one["unit"] == expected["unit"]
        assert one["terms"] == pytest.approx(expected["terms"])
        assert abs(one["value"] - expected["value"]) < expected["tolerance"]
        assert one["standard_uncertainty"] == pytest.approx(expected["crlb"], rel=0.35)
    determined = {one["name"] for one in truth["expected"]}
    assert all(one["value"] is None for name, one in found.items() if name not in determined)
    assert [flag["code"] for flag in data["flags"]] == [flag["code"] for flag in truth["flags"]]
    assert data["flags"][0]["coefficients"] == truth["not_identifiable"]
    assert {one["method"] for one in data["as_published"]} == {"finite-memory"}


def test_a_dataset_may_lack_the_temperature(tmp_path: Path) -> None:
    place = copy_of(THREE, tmp_path)
    rows = (place / "samples.csv").read_text(encoding="utf-8").splitlines()
    index = rows[0].split(",").index("temperature_degC")
    cut = [",".join(c for n, c in enumerate(row.split(",")) if n != index) for row in rows]
    (place / "samples.csv").write_text("\n".join(cut) + "\n", encoding="utf-8")
    document = analysed(place)
    whole = analysed(DATA / THREE)
    for one, other in zip(document.results, whole.results, strict=True):
        value, u = other.estimate.value, other.estimate.standard_uncertainty or 0.0
        assert one.estimate.value == (value and pytest.approx(value, abs=0.05 * u))
    out = tmp_path / "out"
    analyse_dataset(place, out)
    assert "No temperature was recorded" in (out / "report.html").read_text(encoding="utf-8")


def test_the_report_shows_what_was_found_and_what_cannot_be(tmp_path: Path) -> None:
    raw = read_dataset(DATA / THREE)
    document, findings = evaluate_dataset(raw)
    parts = draw_parts(findings, document)
    assert [type(part) for part in parts] == [Table, Plot, Plot, Plot, Plot, Table]
    coefficients = parts[0]
    assert isinstance(coefficients, Table)
    assert "K0 + Kpp, Kii − Kpp and Koo − Kpp" in coefficients.caption
    assert len(coefficients.rows) == 13
    analyse_dataset(DATA / THREE, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for title in ("Output against field", "Convergence", "Correlation", "Condition number"):
        assert title in page
