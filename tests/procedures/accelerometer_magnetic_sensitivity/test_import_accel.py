"""Imported accelerometer datasets: the examples within tolerance, every fault in one sentence."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from places import DATA

from procedures.accelerometer_magnetic_sensitivity.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.files.faults import FaultList
from station.report.parts import Plot, Table
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


def changed(name: str, folder: Path, file: str, old: str, new: str) -> Path:
    place = copy_of(name, folder)
    text = (place / file).read_text(encoding="utf-8")
    assert old in text
    (place / file).write_text(text.replace(old, new), encoding="utf-8")
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
        assert one.estimate.value == other.estimate.value
    out = tmp_path / "out"
    analyse_dataset(place, out)
    assert "No temperature was recorded" in (out / "report.html").read_text(encoding="utf-8")


def test_missing_and_overloaded_rows_are_analysed_and_flagged(tmp_path: Path) -> None:
    place = copy_of(THREE, tmp_path)
    rows = (place / "samples.csv").read_text(encoding="utf-8").splitlines()
    head, *body = rows
    cells = body[60].split(",")
    body[60] = ",".join([*cells[:-1], "9.9E+37"])
    cells = body[100].split(",")
    body[100] = ",".join([*cells[:-1], str(float(cells[-1]) + 0.01)])
    del body[20:30]
    (place / "samples.csv").write_text("\n".join([head, *body]) + "\n", encoding="utf-8")
    data = analysed(place).to_data()
    flags = {flag["code"]: flag for flag in data["flags"]}
    assert set(flags) == {"not-identifiable", "overload", "outliers-rejected", "gap"}
    assert flags["overload"]["rows"] == [50]
    assert flags["outliers-rejected"]["rows"] == [90]
    assert flags["gap"]["missing_samples"] == 10
    truth = json.loads((DATA / THREE / "truth.json").read_text(encoding="utf-8"))
    found = {one["name"]: one["value"] for one in data["results"]}
    for expected in truth["expected"]:
        assert abs(found[expected["name"]] - expected["value"]) < expected["tolerance"]


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("dataset.yaml", "local_gravity: 1 g", "local_gravity: 1", "local_gravity"),
        ("dataset.yaml", "local_gravity: 1 g", "local_gravity: 1 mT", "local_gravity"),
        ("dataset.yaml", "local_gravity: 1 g", "local_gravity: 50 g", "dataset.yaml:5:18: cond"),
        ("dataset.yaml", "local_gravity: 1 g", "local_gravityy: 1 g", "did you mean"),
        ("dataset.yaml", "samples: samples.csv", "sample: samples.csv", "samples"),
        ("samples.csv", "theta_deg", "theta", "theta_deg"),
        ("samples.csv", "\n10.0,io,", "\n10.0,oi,", "there is no plane 'oi'"),
        ("samples.csv", "\n20.0,io,", "\n5.0,io,", "times must rise"),
        ("samples.csv", "\n10.0,io,0.00000", "\n10.0,io,zero", "theta_deg"),
        ("samples.csv", "\n10.0,io,0.00000,0.02", "\n10.0,io,0.00000,20", "3:1: field_commanded"),
    ],
)
def test_a_fault_is_one_sentence_with_its_place(
    tmp_path: Path, file: str, old: str, new: str, said: str
) -> None:
    place = changed(ONE, tmp_path, file, old, new)
    with pytest.raises(FaultList) as caught:
        analysed(place)
    assert said in str(caught.value)
    assert file in str(caught.value)


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
