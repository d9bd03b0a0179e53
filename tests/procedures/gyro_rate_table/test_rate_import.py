"""Imported records of a rate table: the example within tolerance, wrong data refused or flagged."""

from __future__ import annotations

import json
from collections.abc import Callable
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
Row = list[str]


def test_the_example_comes_out_within_its_tolerance() -> None:
    findings = findings_of_dataset(read_dataset(DATA))
    truth = json.loads((DATA / "truth.json").read_text(encoding="utf-8"))
    found = {one.name: one for one in findings.estimates}
    assert len(found) == len(truth["expected"]) == 6
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


def findings_with(folder: Path, change: Callable[[Row], Row | None]) -> Findings:
    """Return what is made of records of which each row is changed or left out."""
    head, *rows = lines(made(np.random.default_rng(7), SHORT))
    changed = [change(row.split(",")) for row in rows]
    place = written(folder / "data", [head, *(",".join(one) for one in changed if one)])
    return findings_of_dataset(read_dataset(place))


def value(findings: Findings, name: str = "scale_factor") -> float | None:
    return next(one.value for one in findings.estimates if one.name == name)


def codes(findings: Findings) -> set[str]:
    return {one.code for one in findings.flags}


def place_of(row: Row) -> tuple[str, int]:
    return row[1], int(row[2])


def is_at(row: Row, rate: str, every: int) -> bool:
    return row[1] == rate and int(row[2]) % every == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r: [r[0], str(-float(r[1])), *r[2:]], "where -1 deg/s were commanded"),
        (lambda r: [*r[:3], r[4], r[3]], "turns at"),
        (lambda r: [*r[:4], f"{np.deg2rad(float(r[4])):.7f}"], "in deg and deg/s"),
        (lambda r: [*r[:4], f"{-float(r[4]) % 360:.5f}"], "positive counter-clockwise"),
        (lambda r: [*r[:4], f"{float(r[4]) * 60 % 360:.5f}"], "in deg and deg/s"),
        (lambda r: [r[0], "10" if r[1] == "50" else r[1], *r[2:]], "where 10 deg/s"),
    ],
    ids=["commanded", "exchanged", "rad", "encoder sense", "arcmin", "wrong label"],
)
def test_an_encoder_that_does_not_fit_the_commands_is_refused(
    tmp_path: Path, change: Callable[[Row], Row], said: str
) -> None:
    with pytest.raises(FaultList) as refused:
        findings_with(tmp_path, change)
    assert "encoder_deg" in str(refused.value) and said in str(refused.value)


def clip(row: Row) -> Row:
    return [*row[:3], f"{max(min(float(row[3]), 49.9), -49.9):.7f}", row[4]]


RIGHT: dict[str, tuple[Callable[[Row], Row | None], str]] = {
    "a wild output": (
        lambda r: [*r[:3], "7.5", r[4]] if is_at(r, "10", 9) else r,
        "outliers-rejected",
    ),
    "a wild angle": (
        lambda r: [*r[:4], "123.4"] if is_at(r, "10", 50) else r,
        "outliers-rejected",
    ),
    "rows lost": (lambda r: None if is_at(r, "-10", 7) else r, "gap"),
    "a record lost": (lambda r: None if r[1] == "-10" else r, "one-sense-only"),
    "saturated": (clip, "overload"),
    "half a turn": (
        lambda r: None if r[1] == "1" and int(r[2]) > 320 else r,
        "part-turns",
    ),
}


@pytest.mark.parametrize("name", RIGHT)
def test_what_is_mended_is_right_and_flagged(tmp_path: Path, name: str) -> None:
    change, code = RIGHT[name]
    findings = findings_with(tmp_path, change)
    assert code in codes(findings), findings.flags
    u = next(one.standard_uncertainty for one in findings.estimates)
    scale = value(findings)
    assert scale is not None and u is not None
    assert abs(scale - 1.000085) < max(4.0 * u, 1e-6)
    assert u < 3e-6


def test_a_gyro_upside_down_has_a_negative_scale_factor_and_says_so(tmp_path: Path) -> None:
    findings = findings_with(tmp_path, lambda r: [*r[:3], f"{-float(r[3]):.7f}", r[4]])
    assert value(findings) == pytest.approx(-1.000085, abs=1e-6)
    assert "contradicts-statement" in codes(findings)
    # Its input axis then points down, where the earth turns the other way.
    assert value(findings, "bias") == pytest.approx(-0.4, abs=0.1)


def test_the_table_off_its_rate_does_not_matter(tmp_path: Path) -> None:
    findings = findings_with(tmp_path, lambda r: [r[0], f"{float(r[1]) * 1.02:g}", *r[2:]])
    assert value(findings) == pytest.approx(1.000085, abs=1e-6)
    assert "rate-differs-from-commanded" in codes(findings)


def test_one_switch_on_shows_no_repeatability(tmp_path: Path) -> None:
    findings = findings_with(tmp_path, lambda r: r)
    assert value(findings, "scale_factor_repeatability") is None
    assert codes(findings) == {"not-identifiable", "not-significant", "outside-published-range"}


def test_one_sense_alone_determines_no_scale_factor(tmp_path: Path) -> None:
    findings = findings_with(tmp_path, lambda r: None if r[1].startswith("-") else r)
    assert value(findings) is None and value(findings, "asymmetry") is None
    assert value(findings, "bias") is not None
    lost = next(one for one in findings.flags if one.code == "not-identifiable")
    assert "scale_factor" in lost.details["coefficients"]


def test_a_table_that_stands_gives_the_bias_alone(tmp_path: Path) -> None:
    findings = findings_with(tmp_path, lambda r: r if r[1] == "0" else None)
    assert value(findings) is None
    assert value(findings, "bias") == pytest.approx(0.4, abs=0.1)


def test_a_dead_output_has_no_scale_factor(tmp_path: Path) -> None:
    findings = findings_with(tmp_path, lambda r: [*r[:3], "0", r[4]])
    assert all(estimate.value is None for estimate in findings.estimates)
    assert {"contradicts-statement", "not-identifiable"} <= codes(findings)


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
    (alignment,) = findings.inputs
    assert alignment.standard_uncertainty == pytest.approx(4.2e-6, rel=0.02)
