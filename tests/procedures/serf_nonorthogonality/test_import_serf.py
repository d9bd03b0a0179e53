"""Imported SERF datasets: the examples within tolerance, every fault in one sentence."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from places import DATA

from procedures.serf_nonorthogonality.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.files.faults import FaultList
from station.report.parts import Plot, Table
from station.runner.evaluation import evaluate_dataset

FOUR, REVERSAL = "serf-four-shots", "serf-polarity-reversal"


def changed(name: str, folder: Path, file: str, old: str, new: str) -> Path:
    place = folder / name
    shutil.copytree(DATA / name, place)
    text = (place / file).read_text(encoding="utf-8")
    assert old in text
    (place / file).write_text(text.replace(old, new), encoding="utf-8")
    return place


@pytest.mark.parametrize("name", [FOUR, REVERSAL])
def test_the_examples_come_out_within_their_tolerance(name: str) -> None:
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))
    data = analyse_dataset(DATA / name, None).to_data()
    found = {(one["name"], one["axis"]): one for one in data["results"]}
    assert len(found) == 10
    for expected in truth["expected"]:
        one = found[expected["name"], expected["axis"]]
        assert one["unit"] == "deg"
        assert abs(one["value"] - expected["value"]) < expected["tolerance"]
        assert one["standard_uncertainty"] == pytest.approx(expected["crlb"], rel=0.1)
    assert {one["method"] for one in data["as_published"]} == {"law-of-cosines"}
    assert [one["axis"] for one in data["as_published"]] == ["xy", "xz", "yz"]
    codes = [flag["code"] for flag in data["flags"]]
    assert codes == (["not-identifiable"] if name == FOUR else ["scale-by-convention"])
    residual = [found["residual_field", axis]["value"] for axis in "xyz"]
    if name == FOUR:
        assert residual == [None] * 3
    else:
        factors = truth["coil_factors"]
        assert residual == pytest.approx(
            [one / factors[0] for one in truth["residual_nT"]], abs=0.03
        )
        values = [found["coil_factor", axis]["value"] for axis in "xyz"]
        assert values == pytest.approx([one / factors[0] for one in factors], abs=1e-3)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("dataset.yaml", "probe_axis: y", "probe_axis: z", "another axis than pump_axis"),
        ("dataset.yaml", "pump_axis: z", "pump_axis: x", "use coil z for a single axis"),
        ("dataset.yaml", "  probe_axis: y\n", "", "probe_axis"),
        ("dataset.yaml", "nuclear_spin: 1.5", "nuclear_spin: 2", "2.5 (Rb-85)"),
        ("dataset.yaml", "28.02495 Hz/nT", "28.02495 nT/Hz", "gyromagnetic_ratio"),
        ("dataset.yaml", "10000 Hz", "1000 Hz", "1000 Hz contradicts the rows"),
        ("dataset.yaml", "known   #", "exact   #", "coil_constants"),
        ("dataset.yaml", "[55 nT, 55 nT, 0 nT]", "[0 nT, 0 nT, 0 nT]", "all fields are zero"),
        ("dataset.yaml", "[55 nT, 55 nT, 0 nT]", "[55 nT, 55 nT]", "field"),
        ("dataset.yaml", "id: s02", "id: s01", "stands twice"),
        ("dataset.yaml", "shots: shots.csv", "shot: shots.csv", "shots"),
        ("shots.csv", "\n0.00010,", "\n-0.00010,", "times must rise"),
        ("shots.csv", "\n0.00010,-0.15452", "\n0.00010,wild", "'wild' is not a number"),
    ],
)
def test_a_fault_is_one_sentence_with_its_place(
    tmp_path: Path, file: str, old: str, new: str, said: str
) -> None:
    with pytest.raises(FaultList) as caught:
        analyse_dataset(changed(FOUR, tmp_path, file, old, new), None)
    assert said in str(caught.value)
    assert file in str(caught.value)


def test_a_shot_without_a_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(FaultList, match="s05: the column is missing"):
        analyse_dataset(changed(FOUR, tmp_path, "dataset.yaml", "id: s02", "id: s05"), None)


def test_missing_rows_and_spikes_are_analysed_and_flagged(tmp_path: Path) -> None:
    place = tmp_path / REVERSAL
    shutil.copytree(DATA / REVERSAL, place)
    head, *rows = (place / "shots.csv").read_text(encoding="utf-8").splitlines()
    cells = rows[300].split(",")
    rows[300] = ",".join([cells[0], "2.5", *cells[2:]])
    del rows[500:510]
    (place / "shots.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    data = analyse_dataset(place, None).to_data()
    flags = {flag["code"]: flag for flag in data["flags"]}
    assert set(flags) == {"outliers-rejected", "gap", "scale-by-convention"}
    assert flags["outliers-rejected"]["count"] == 1
    assert flags["gap"]["missing_samples"] == 140
    truth = json.loads((DATA / REVERSAL / "truth.json").read_text(encoding="utf-8"))
    found = {(one["name"], one["axis"]): one["value"] for one in data["results"]}
    for expected in truth["expected"]:
        value = found[expected["name"], expected["axis"]]
        assert abs(value - expected["value"]) < expected["tolerance"]


def test_the_report_shows_angles_checks_shots_and_spectra() -> None:
    document, findings = evaluate_dataset(read_dataset(DATA / REVERSAL))
    parts = draw_parts(findings, document)
    assert [type(part) for part in parts] == [Table, Table, Table, *[Plot] * 4, Table]
    angles, coils, checks = parts[:3]
    assert isinstance(angles, Table) and isinstance(coils, Table) and isinstance(checks, Table)
    assert "arcsec" in " ".join(angles.columns)
    assert len(parts[-1].rows) == 14  # type: ignore[union-attr]
    assert "Slowing-down factor" in coils.caption
    assert [row[-1] for row in checks.rows] == ["yes"] * 5
