"""A channel of a nine-axis dataset that stands still costs its own results, and is named."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import pytest
from nine_axis_stands import FACES, Bench, truth_of, write

from station.cli.analysing import analyse_dataset
from station.results import ResultDocument

BENCH = Bench(9, poses=FACES)


def rewritten(
    folder: Path, name: str, column: str, change: Callable[[float], float]
) -> ResultDocument:
    """Return the results of a dataset with another column in one of its files."""
    place = write(Bench(9, poses=FACES).data(), folder)
    with (place / name).open(newline="") as file:
        header, *rows = csv.reader(file)
    at = header.index(column)
    for row in rows:
        row[at] = f"{change(float(row[at])):.9g}"
    with (place / name).open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return analyse_dataset(place, None)


def values(document: ResultDocument) -> dict[str, float | None]:
    return {
        f"{result.estimate.name} {result.estimate.axis}": result.estimate.value
        for result in document.results
    }


@pytest.mark.parametrize("stands_at", [0.0, 0.001])
def test_a_dead_gyro_on_the_table_is_frozen_and_the_other_gyros_have_results(
    tmp_path: Path, stands_at: float
) -> None:
    document = rewritten(tmp_path, "rate.csv", "gx_deg_per_s", lambda _: stands_at)
    got = values(document)
    for lost in ("scale_factor X", "asymmetry X", "misalignment XY", "misalignment XZ"):
        assert got[lost] is None
    assert got["scale_factor Y"] is not None
    assert got["misalignment YZ"] is not None
    assert {flag.axis for flag in document.flags if flag.code == "frozen"} == {"X"}


def test_a_gyro_in_steps_beyond_what_it_feels_across_has_no_misalignment(tmp_path: Path) -> None:
    document = rewritten(tmp_path, "rate.csv", "gy_deg_per_s", lambda value: 2.0 * round(value / 2))
    got = values(document)
    assert got["misalignment YX"] is None
    assert got["misalignment YZ"] is None
    assert got["misalignment XY"] is not None
    assert not any("rad/s" in flag.message for flag in document.flags)


@pytest.mark.parametrize(
    ("name", "column", "axis"),
    [("static.csv", "az_g", "Z"), ("poses.csv", "ax_g", "X"), ("rate.csv", "ax_g", "X")],
)
def test_a_dead_accelerometer_is_named_and_moves_no_other_result(
    tmp_path: Path, name: str, column: str, axis: str
) -> None:
    document = rewritten(tmp_path, name, column, lambda _: -0.5)
    assert ("frozen", axis) in {(flag.code, flag.axis) for flag in document.flags}
    assert {flag.code for flag in document.flags}.isdisjoint(
        {"poses-disagree", "contradicts-statement"}
    )
    assert not any("nan" in flag.message.split() for flag in document.flags)
    truth = truth_of(BENCH.sensor)
    for result in document.results:
        estimate, combined = result.estimate, result.combined
        if estimate.name == "magnetometer_offset" and combined is not None:
            assert estimate.value is not None
            assert estimate.axis is not None
            error = estimate.value - truth[estimate.name, estimate.axis]
            assert abs(error) < 5.0 * combined.standard_uncertainty
