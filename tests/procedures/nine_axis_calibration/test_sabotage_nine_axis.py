"""Faults planted in nine-axis datasets: what would end in a wrong number is named by its cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sabotage_nine_axis
from nine_axis_records import Setting, codes, record, total_u
from sabotage import analysed, error_u, judged

from procedures.nine_axis_calibration.analysis import analyse

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


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_coarse_turning_output_is_coarse_and_nothing_else(step: float) -> None:
    clean = record(Setting())
    turns = tuple(
        replace(one, rate_deg_per_s=np.round(one.rate_deg_per_s / step) * step)
        for one in clean.turns
    )
    found = analyse(replace(clean, turns=turns))
    assert "coarse-output" in codes(found)
    assert not codes(found) & {"outliers-rejected", "misfit", "overload", "one-sense-only"}
    for axis in "XYZ":
        assert total_u(found, "scale_factor", axis) < 0.1 * step


def test_a_gyro_that_stands_still_in_each_record_at_rest_is_frozen() -> None:
    clean = record(Setting())
    static = tuple(replace(one, rate_deg_per_h=one.rate_deg_per_h.copy()) for one in clean.static)
    for one in static:
        count = len(one.rate_deg_per_h)
        one.rate_deg_per_h[count // 2 : count // 2 + count // 7, 0] = one.rate_deg_per_h[0, 0]
    assert "frozen" in codes(analyse(replace(clean, static=static)))


def test_a_bias_that_changed_between_positions_is_no_other_unit() -> None:
    clean = record(Setting())
    step = np.array([0.5, 0.0, 0.0])
    moved = [
        replace(one, rate_deg_per_h=one.rate_deg_per_h + step * (one.position == 2))
        for one in clean.static
    ]
    flags = analyse(replace(clean, static=tuple(moved))).flags
    (said,) = [one.message for one in flags if one.code == "contradicts-statement"]
    assert "a bias changed between the positions" in said
    assert "unit" not in said
