"""Imported SERF datasets: the examples within tolerance, and their report."""

from __future__ import annotations

import json

import pytest
from places import DATA

from procedures.serf_nonorthogonality.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.parts import Table
from station.plots import Plot
from station.runner.evaluation import evaluate_dataset

FOUR, REVERSAL = "serf-four-shots", "serf-polarity-reversal"


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


@pytest.mark.campaign
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
