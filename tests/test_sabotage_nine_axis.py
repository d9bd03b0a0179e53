"""Faults planted in nine-axis datasets: what would end in a wrong number is named by its cause."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import sabotage_nine_axis
from sabotage import analysed, error_u, judged

PLANTED = {one.name: one for one in sabotage_nine_axis.FAULTS}
NAMED = (
    ("gyros X and Y exchanged at rest", 0, "wrong-position"),
    ("rates at rest in deg/s", 1, "contradicts-statement"),
    ("southern latitude", 0, "contradicts-statement"),
    ("gyro Z a copy of Y at rest", 2, "frozen"),
    ("bias drifts 1 deg/h in a record", 0, "bias-wanders"),
    ("turned gyro inverted", 2, "contradicts-statement"),
    ("rates in rad/s", 0, "contradicts-statement"),
    ("mounted 4 deg askew", 0, "contradicts-statement"),
    ("clock 300 ppm off in one record", 0, "misfit"),
    ("offset 8 deg/h in the slowest", 1, "misfit"),
    ("mains beat", 1, "misfit"),
    ("encoder graduation 0.01 deg", 0, "misfit"),
    ("clipped at exactly 100 deg/s", 2, "overload"),
    ("gyro reads zero in a record", 1, "frozen"),
    ("axis Y a copy of X", 2, "frozen"),
    ("output in steps of 0.01 deg/s", 1, "coarse-output"),
)


@pytest.mark.parametrize(("name", "seed", "code"), NAMED)
def test_a_fault_that_the_data_show_is_named(name: str, seed: int, code: str) -> None:
    found = judged(PLANTED[name], seed)
    assert code in found["flags"]
    assert not found["broken"]


@pytest.mark.parametrize("kind", range(len(sabotage_nine_axis.KINDS)))
def test_clean_datasets_raise_no_flag_of_a_fault(kind: int) -> None:
    made = sabotage_nine_axis.CLEAN[kind](1003 + kind)
    document = analysed(made)
    assert {one["code"] for one in document["flags"]} <= sabotage_nine_axis.USUAL_FLAGS
    assert 0.0 < error_u(made, document["results"]) < 4.0


def test_a_wrong_latitude_takes_the_biases_with_it() -> None:
    planted = PLANTED["southern latitude"].planted(0)
    document = analysed(planted)
    biases = [one for one in document["results"] if one["name"] == "bias"]
    assert [one["value"] for one in biases] == [None] * 3
    (flag,) = [one for one in document["flags"] if one["code"] == "contradicts-statement"]
    assert flag["statement"] == "latitude"
    assert flag["latitude_deg"] == pytest.approx(39.9, abs=1.0)


def test_a_graduation_that_the_gyro_does_not_feel_is_taken_off() -> None:
    planted = PLANTED["encoder graduation 0.01 deg"].planted(0)
    document = analysed(planted)
    assert error_u(planted, document["results"]) < 4.0
    sizes = [one["amplitude_deg"] for one in document["flags"] if one["code"] == "misfit"]
    assert sizes == pytest.approx([0.01] * 3, rel=0.01)
