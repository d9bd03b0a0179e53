"""Imported nine-axis datasets: the example within tolerance, published rules, the report."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import pytest
from places import DATA

from procedures.nine_axis_calibration.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.plots import Plot
from station.results import ResultDocument
from station.runner.evaluation import evaluate_dataset

DATA = DATA / "nine-axis"


def analysed(path: Path) -> ResultDocument:
    return analyse_dataset(path, None)


def copy_of(folder: Path) -> Path:
    place = folder / DATA.name
    shutil.copytree(DATA, place)
    return place


def within_tolerance(data: dict) -> None:  # type: ignore[type-arg]
    truth = json.loads((DATA / "truth.json").read_text(encoding="utf-8"))
    found = {(one["name"], one["axis"]): one for one in data["results"]}
    for expected in truth["expected"]:
        one = found[expected["name"], expected["axis"]]
        assert one["unit"] == expected["unit"]
        assert abs(one["value"] - expected["value"]) < expected["tolerance"], one
        assert one["standard_uncertainty"] == pytest.approx(expected["crlb"], rel=0.15)


def test_the_example_comes_out_within_its_tolerance() -> None:
    data = analysed(DATA).to_data()
    within_tolerance(data)
    names = [one["name"] for one in data["results"]]
    assert {name: names.count(name) for name in set(names)} == {
        "bias": 3,
        "scale_factor": 3,
        "asymmetry": 3,
        "nonlinearity": 3,
        "misalignment": 6,
    }
    crossed = [one for one in data["results"] if one["name"] == "misalignment"]
    assert [one["axis"] for one in crossed] == ["XY", "XZ", "YX", "YZ", "ZX", "ZY"]
    assert all(one["value"] is None for one in crossed)
    flags = {flag["code"]: flag for flag in data["flags"]}
    assert set(flags) == {"part-turns", "not-significant", "not-identifiable"}
    assert flags["part-turns"]["rates"] == [1.0, 5.0, 10.0, 50.0, 100.0]


def test_the_published_rules_stand_beside_the_best_estimate() -> None:
    data = analysed(DATA).to_data()
    published = {(one["name"], one["axis"]): one for one in data["as_published"]}
    assert {one["method"] for one in published.values()} == {"mean"}
    rows = [row.split(",") for row in (DATA / "static.csv").read_text("utf-8").split()[1:]]
    east = [float(row[2]) for row in rows if row[0] == "1"]
    assert published["bias", "X"]["value"] == pytest.approx(sum(east) / len(east))
    rows = [row.split(",") for row in (DATA / "rate.csv").read_text("utf-8").split()[1:]]
    total = 0.0
    for rate in (1, 5, 10, 50, 100):
        up, down = (
            [float(r[3]) for r in rows if r[0] == "Z" and float(r[1]) == sense * rate]
            for sense in (1, -1)
        )
        total += (sum(up) / len(up) - sum(down) / len(down)) / (2 * rate) / 5
    assert published["scale_factor", "Z"]["value"] == pytest.approx(total, abs=1e-12)


def test_the_priors_of_the_dataset_are_in_the_budget() -> None:
    document = analysed(DATA)
    bias = next(one for one in document.results if one.estimate.name == "bias")
    said = [line.description for line in bias.budget if line.kind == "B"]
    assert any("heading of the plate, 10 arcmin" in line for line in said)


def test_the_latitude_moves_the_biases_by_its_row_of_the_budget(tmp_path: Path) -> None:
    place = copy_of(tmp_path)
    path = place / "dataset.yaml"
    told = path.read_text(encoding="utf-8")
    stated = told.replace(
        "latitude: 39.9 deg", "latitude: 39.91 deg\n  latitude_uncertainty: 1 arcmin"
    )
    path.write_text(stated, encoding="utf-8")
    for axis in "XYZ":
        nominal, moved = (analysed(folder).result("bias", axis) for folder in (DATA, place))
        rows = [
            {line.quantity: line for line in one.budget}["latitude"] for one in (nominal, moved)
        ]
        assert (rows[0].standard_uncertainty, rows[0].source) == (None, "not stated")
        assert rows[1].contribution == pytest.approx(abs(rows[0].sensitivity) / 3437.75, rel=1e-2)
        off = (moved.estimate.value or 0.0) - (nominal.estimate.value or 0.0)
        assert off == pytest.approx(rows[0].sensitivity * math.radians(0.01), rel=1e-2)


def test_all_three_gyros_may_be_recorded_on_the_table(tmp_path: Path) -> None:
    place = copy_of(tmp_path)
    lines = (place / "rate.csv").read_text(encoding="utf-8").splitlines()
    fresh = ["axis,commanded_deg_per_s,t_s,gx_deg_per_s,gy_deg_per_s,gz_deg_per_s,encoder_deg"]
    for line in lines[1:]:
        axis, commanded, time_s, rate, encoder = line.split(",")
        three = [f"{1e-4 * float(rate):.7f}"] * 3
        three["XYZ".index(axis)] = rate
        fresh.append(",".join([axis, commanded, time_s, *three, encoder]))
    (place / "rate.csv").write_text("\n".join(fresh) + "\n", encoding="utf-8")
    data = analysed(place).to_data()
    crossed = [one for one in data["results"] if one["name"] == "misalignment"]
    assert [one["value"] for one in crossed] == pytest.approx([20.6] * 6, abs=0.1)


def test_the_report_shows_pose_records_rates_and_gain(tmp_path: Path) -> None:
    document, findings = evaluate_dataset(read_dataset(DATA))
    parts = draw_parts(findings, document)
    assert [part.title for part in parts] == [
        "Positions",
        "Pose check",
        "Static records and Allan deviation",
        "Scale factor rate by rate",
        "Gain matrix",
        "Correction",
    ]
    assert sum(isinstance(part, Plot) for part in parts) == 3
    analyse_dataset(DATA, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for title in ("Pose check", "Allan deviation", "Gain matrix"):
        assert title in page
