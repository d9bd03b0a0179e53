"""Imported records of a rate table: the example within tolerance, stamps, counts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from places import DATA
from rate_records import CONDITIONS, Gyro, lines, made, written

from procedures.gyro_rate_table.evaluate import findings_of_dataset
from station.dataset_reading import read_dataset
from station.files.faults import FaultList
from station.findings import Findings

DATA = DATA / "gyro-rate-table"


def test_the_example_comes_out_within_its_tolerance() -> None:
    findings = findings_of_dataset(read_dataset(DATA))
    truth = json.loads((DATA / "truth.json").read_text(encoding="utf-8"))
    found = {one.name: one for one in findings.estimates}
    assert len(found) == len(truth["expected"]) == 6
    assert found["scale_factor_repeatability"].extra == {"switch_ons": 2}
    for expected in truth["expected"]:
        one = found[expected["name"]]
        assert one.unit == expected["unit"] and one.axis == expected["axis"]
        assert one.value is not None and one.standard_uncertainty is not None
        assert abs(one.value - expected["value"]) < expected["tolerance"], one
        assert one.standard_uncertainty > expected.get("u_min", 0.0)
    assert not {one.code for one in findings.flags} & {"part-turns", "overload", "not-significant"}
    published = {one.name: one.value for one in findings.published}
    assert abs((published["asymmetry"] or 0.0) - 6.0) > 10.0  # the table is off its rates


SHORT = Gyro(rates=(1.0, 10.0, 50.0), repeats=1)


def value(findings: Findings, name: str = "scale_factor") -> float | None:
    return next(one.value for one in findings.estimates if one.name == name)


@pytest.mark.parametrize("stamp", ["interval-start", "interval-middle"])
def test_stamps_say_which_instant_the_angle_is_of(tmp_path: Path, stamp: str) -> None:
    head, *rows = lines(made(np.random.default_rng(7), SHORT))
    conditions = CONDITIONS.replace("interval-end", stamp)
    findings = findings_of_dataset(read_dataset(written(tmp_path / "d", [head, *rows], conditions)))
    # The rate is even: which instant it is costs an edge and no more.
    assert value(findings) == pytest.approx(1.000085, abs=1e-6)


def test_counts_need_their_weight_and_give_the_same(tmp_path: Path) -> None:
    head, *rows = lines(made(np.random.default_rng(7), SHORT), "counts")
    weight = 0.05
    total = 0.0
    counted = []
    for row in rows:
        cells = row.split(",")
        before = np.floor(total)
        total += float(cells[3]) * 3600.0 / weight
        counted.append(",".join([*cells[:3], f"{np.floor(total) - before:.0f}", cells[4]]))
    conditions = CONDITIONS.replace("gyro_output: rate", "gyro_output: counts")
    with pytest.raises(FaultList, match="pulse_weight"):
        findings_of_dataset(read_dataset(written(tmp_path / "no", [head, *counted], conditions)))
    conditions += f"  pulse_weight: {weight} arcsec\n  clock: 1 ppm\n  alignment: 10 arcmin\n"
    findings = findings_of_dataset(
        read_dataset(written(tmp_path / "d", [head, *counted], conditions))
    )
    assert value(findings) == pytest.approx(1.000085, abs=1e-6)
    # Pulses over an angle need no clock; a lean of 10 arcmin takes 4.2 ppm.
    stated = {given.name: given for given in findings.inputs if given.standard_uncertainty}
    assert list(stated) == ["alignment"]
    assert stated["alignment"].standard_uncertainty == pytest.approx(4.2e-6, rel=0.02)


def test_the_range_is_a_condition(tmp_path: Path) -> None:
    rows = list(lines(made(np.random.default_rng(7), SHORT)))
    plain = findings_of_dataset(read_dataset(written(tmp_path / "plain", rows)))
    conditions = CONDITIONS + "  range: 300 deg/s\n"
    ranged = findings_of_dataset(read_dataset(written(tmp_path / "ranged", rows, conditions)))
    name = "nonlinearity_of_full_scale"
    assert value(ranged, name) == pytest.approx((value(plain, name) or 0.0) * 50.0 / 300.0)
