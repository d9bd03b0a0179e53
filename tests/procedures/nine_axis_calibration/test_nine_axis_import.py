"""Imported nine-axis datasets: the example within tolerance, every fault in one sentence."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from places import DATA

from procedures.nine_axis_calibration.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.files.faults import FaultList
from station.report.parts import Plot
from station.results import ResultDocument
from station.runner.evaluation import evaluate_dataset

DATA = DATA / "nine-axis"
HEAD = "position,t_s,gx_deg_per_h"
ROW = "\n1,2,0.0955,11.9633,9.9913,"


def analysed(path: Path) -> ResultDocument:
    return analyse_dataset(path, None)


def copy_of(folder: Path) -> Path:
    place = folder / DATA.name
    shutil.copytree(DATA, place)
    return place


def changed(folder: Path, file: str, old: str, new: str) -> Path:
    place = copy_of(folder)
    text = (place / file).read_text(encoding="utf-8")
    assert old in text
    (place / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    return place


def rewritten(folder: Path, file: str, change) -> Path:  # type: ignore[no-untyped-def]
    """Return a copy of the dataset with the rows (lists of cells) of a file changed."""
    place = copy_of(folder)
    head, *rows = (place / file).read_text(encoding="utf-8").splitlines()
    fresh = change([row.split(",") for row in rows])
    lines = [head, *(",".join(row) for row in fresh)]
    (place / file).write_text("\n".join(lines) + "\n", encoding="utf-8")
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


def test_missing_and_wild_rows_are_analysed_and_flagged(tmp_path: Path) -> None:
    def spoil(rows: list[list[str]]) -> list[list[str]]:
        for n in range(5, len(rows), 97):
            rows[n][3] = "250.0"
        return rows[:100] + rows[130:]

    place = rewritten(tmp_path, "static.csv", spoil)
    data = analysed(place).to_data()
    within_tolerance(data)
    flags = {flag["code"]: flag for flag in data["flags"]}
    assert flags["gap"]["missing_samples"] == 30
    assert flags["outliers-rejected"]["axis"] == "Y"


def test_a_wrong_position_is_named(tmp_path: Path) -> None:
    def swap(rows: list[list[str]]) -> list[list[str]]:
        # As position 1 turned by 180 deg: north gives Y the other sign, and X nothing.
        return [[*r[:2], "-0.3", "-11.4", *r[4:]] if r[0] == "2" else r for r in rows]

    data = analysed(rewritten(tmp_path, "static.csv", swap)).to_data()
    wrong = [flag for flag in data["flags"] if flag["code"] == "wrong-position"]
    assert [flag["position"] for flag in wrong] == [2]
    truth = {
        one["axis"]: one for one in json.loads((DATA / "truth.json").read_text())["expected"][:3]
    }
    for one in data["results"][:3]:
        assert one["value"] is not None
        assert abs(one["value"] - truth[one["axis"]]["value"]) < 2 * truth[one["axis"]]["tolerance"]


def test_a_skipped_position_is_said(tmp_path: Path) -> None:
    place = rewritten(tmp_path, "static.csv", lambda rows: [r for r in rows if r[0] != "2"])
    data = analysed(place).to_data()
    missing = [flag for flag in data["flags"] if flag["code"] == "position-missing"]
    assert [flag["position"] for flag in missing] == [2]
    assert next(o for o in data["as_published"] if o["axis"] == "Y")["value"] is None


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


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("dataset.yaml", "  latitude: 39.9 deg\n", "", "conditions.latitude"),
        ("dataset.yaml", "latitude: 39.9 deg", "latitude: 39.9", "latitude"),
        ("dataset.yaml", "latitude: 39.9 deg", "latitude: 39.9 mT", "latitude"),
        ("dataset.yaml", "    heading: 10 arcmin", "    headin: 10 arcmin", "did you mean"),
        ("dataset.yaml", ", rate: rate.csv", "", "files.rate"),
        ("static.csv", HEAD, "position,t_s,gx", "gx_deg_per_h"),
        ("static.csv", ROW, "\n1,2,fast,11.9633,9.9913,", "'fast' is not a number"),
        ("static.csv", ROW, "\n9,2,0.0955,11.9633,9.9913,", "there is no position 9"),
        ("static.csv", ROW, "\n1,0.5,0.0955,11.9633,9.9913,", "times must rise"),
        ("rate.csv", "rate_deg_per_s", "rate_deg", "rate_deg_per_s"),
        ("rate.csv", "\nX,1,2,", "\nW,1,2,", "'W' is no direction"),
        ("rate.csv", "\nX,1,2,", "\nX,0,2,", "at rest"),
        ("rate.csv", "\nX,1,3,", "\nX,1,1.5,", "times must rise"),
    ],
)
def test_a_fault_is_one_sentence_with_its_place(
    tmp_path: Path, file: str, old: str, new: str, said: str
) -> None:
    place = changed(tmp_path, file, old, new)
    with pytest.raises(FaultList) as caught:
        analysed(place)
    assert said in str(caught.value)
    assert file in str(caught.value)


def test_an_encoder_that_counts_the_other_way_is_a_fault(tmp_path: Path) -> None:
    def reverse(rows: list[list[str]]) -> list[list[str]]:
        return [[*row[:4], f"{360 - float(row[4]):.5f}"] for row in rows]

    with pytest.raises(FaultList) as caught:
        analysed(rewritten(tmp_path, "rate.csv", reverse))
    assert "counter-clockwise" in str(caught.value)


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
