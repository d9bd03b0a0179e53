"""The analysis of a nine-axis sensor: truth, heading, rates, bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nine_axis_records import (
    ARCMIN,
    ASYMMETRY,
    BIAS,
    HORIZONTAL,
    LATITUDE_DEG,
    PRIOR,
    SCALE,
    Setting,
    codes,
    off_in_u,
    record,
    total_u,
)
from scipy.special import stdtrit

from procedures.estimation.turn_encoder import unwrap
from procedures.nine_axis_calibration.analysis import analyse
from procedures.nine_axis_calibration.directions import PoseLimits
from procedures.nine_axis_calibration.outlook import expected_uncertainty
from procedures.nine_axis_calibration.pose import (
    ATTITUDES,
    check_pose,
    expected_rates,
    gravity_pattern,
)

ORDINARY = {"not-significant"}


def value(analysis, name: str, axis: str) -> float:
    found = analysis.estimate(name, axis).value
    assert found is not None
    return float(found)


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_the_uncertainty_of_coarse_turning_output_is_a_small_part_of_its_step(step: float) -> None:
    clean = record(Setting())
    turns = tuple(
        replace(turn, rate_deg_per_s=np.round(turn.rate_deg_per_s / step) * step)
        for turn in clean.turns
    )
    found = analyse(replace(clean, turns=turns))
    assert "coarse-output" in codes(found)
    for axis in "XYZ":
        assert total_u(found, "scale_factor", axis) < 0.1 * step


def test_positions_are_right_handed_and_flipped_ones_face_west() -> None:
    for axes in ATTITUDES.values():
        assert np.linalg.det(axes) == pytest.approx(1.0)
    for position, axis in ((1, 0), (2, 1), (3, 2)):
        assert ATTITUDES[position][axis] == pytest.approx([1, 0, 0])
        assert ATTITUDES[position + 3] == pytest.approx(ATTITUDES[position] * [-1, -1, 1])
    assert expected_rates(3, LATITUDE_DEG)[0] == pytest.approx(HORIZONTAL, rel=1e-6)


@pytest.mark.parametrize("heading", [0.0, 10.0, 30.0])
def test_without_noise_the_truth_comes_back_at_any_heading(heading: float) -> None:
    analysis = analyse(record(Setting(heading_arcmin=heading, noise=1e-6)), allan=False)
    for axis, name in enumerate("XYZ"):
        assert value(analysis, "bias", name) == pytest.approx(BIAS[axis], abs=2e-5)
        assert value(analysis, "scale_factor", name) == pytest.approx(SCALE[axis], abs=1e-9)
        assert value(analysis, "asymmetry", name) == pytest.approx(1e6 * ASYMMETRY[axis], abs=0.01)
    assert analysis.bias is not None
    assert analysis.bias.heading_rad == pytest.approx(heading * ARCMIN, abs=2e-5)
    assert value(analysis, "misalignment", "ZX") == pytest.approx(-6e-4 * 206264.8, abs=0.02)


def test_noise_is_answered_by_uncertainties_that_are_the_bound() -> None:
    setting = Setting(dwell_s=360)
    analysis = analyse(record(setting), allan=False)
    bound = expected_uncertainty(
        (1, 2, 3),
        setting.static_s,
        np.array(setting.rates),
        np.full(5, 360.0),
        0.01,
        LATITUDE_DEG,
        PRIOR,
    )
    for axis, name in enumerate("XYZ"):
        assert total_u(analysis, "bias", name) == pytest.approx(bound.bias_deg_per_h[axis], rel=0.1)
        scale = analysis.estimate("scale_factor", name)
        assert scale.standard_uncertainty == pytest.approx(bound.scale_factor, rel=0.1)
        asymmetry = analysis.estimate("asymmetry", name)
        assert asymmetry.standard_uncertainty == pytest.approx(1e6 * bound.asymmetry, rel=0.1)
    assert max(off_in_u(analysis).values()) < 3.5
    assert codes(analysis) <= ORDINARY


@pytest.mark.campaign
def test_95_percent_intervals_hold_the_truth_95_times_in_100() -> None:
    inside, total = 0, 0
    for seed in range(30):
        setting = Setting(seed, static_s=100, heading_arcmin=5.0)
        analysis = analyse(record(setting), allan=False)
        for (name, axis), off in off_in_u(analysis).items():
            freedom = analysis.estimate(name, axis).degrees_of_freedom
            assert freedom is not None
            inside += off <= stdtrit(freedom, 0.975)
            total += 1
    # The estimates of a record are not independent: about 1 % of standard error.
    assert 0.925 <= inside / total <= 0.975


def test_a_heading_error_moves_the_published_bias_and_not_the_best_one() -> None:
    analysis = analyse(record(Setting(heading_arcmin=30.0, static_s=600)), allan=False)
    shift = HORIZONTAL * 30.0 * ARCMIN
    published = {one.axis: one.value for one in analysis.published if one.name == "bias"}
    for axis, name in enumerate("XYZ"):
        assert published[name] == pytest.approx(BIAS[axis] - shift, abs=0.09)
        assert abs(value(analysis, "bias", name) - BIAS[axis]) < 4 * total_u(analysis, "bias", name)
    assert "heading-differs-from-prior" in codes(analysis)
    assert analysis.bias is not None
    assert not analysis.bias.heading_used


def test_a_flip_to_the_west_is_used_like_any_other_position() -> None:
    three = analyse(record(Setting(static_s=300)), allan=False)
    six = analyse(record(Setting(positions=(1, 4, 2, 5, 3, 6), static_s=300)), allan=False)
    assert total_u(six, "bias", "X") < 0.75 * total_u(three, "bias", "X")
    assert max(off_in_u(six).values()) < 3.5


def test_rates_that_agree_are_weighted_and_those_that_do_not_count_alike() -> None:
    agreeing = analyse(record(), allan=False)
    assert agreeing.estimate("scale_factor", "X").method == "weighted"
    assert value(agreeing, "nonlinearity", "X") > 0.0
    weak = [flag for flag in agreeing.flags if flag.details.get("name") == "nonlinearity"]
    assert {flag.axis for flag in weak} == {"X", "Y", "Z"}
    bent = record(Setting(nonlinearity_ppm=(20.0, -25.0, 10.0, -15.0, 10.0), noise=0.02))
    analysis = analyse(bent, allan=False)
    scale = analysis.estimate("scale_factor", "X")
    assert scale.method == "mean"
    assert value(analysis, "scale_factor", "X") == pytest.approx(SCALE[0], abs=2e-6)
    assert value(analysis, "nonlinearity", "X") == pytest.approx(25.0, abs=3.0)
    rates = analysis.estimate("nonlinearity", "X").extra["rates"]
    assert [one["rate_deg_per_s"] for one in rates] == [1, 5, 10, 50, 100]  # type: ignore[attr-defined]


def test_the_tables_rate_comes_from_its_encoder_and_not_from_the_plan() -> None:
    analysis = analyse(record(Setting(table_ppm=100.0)), allan=False)
    published = {one.axis: one.value for one in analysis.published if one.name == "scale_factor"}
    for axis, name in enumerate("XYZ"):
        assert value(analysis, "scale_factor", name) == pytest.approx(SCALE[axis], abs=2e-6)
        assert published[name] == pytest.approx(SCALE[axis] + 1e-4, abs=2e-5)


def test_one_position_is_judged_alone_before_it_is_accepted() -> None:
    for position in (1, 2, 3):
        rates = expected_rates(position, LATITUDE_DEG) + BIAS
        gravity = gravity_pattern(position)
        assert check_pose(position, rates, gravity, LATITUDE_DEG, PoseLimits()).right
        other = position % 3 + 1
        wrong = check_pose(other, rates, gravity, LATITUDE_DEG, PoseLimits())
        assert not wrong.right
        assert wrong.stands_as == position
        assert wrong.why


@pytest.mark.parametrize("rate", [1.0, -100.0, 50.0])
def test_an_encoder_is_counted_through_turns_gaps_and_a_wild_reading(rate: float) -> None:
    time_s = np.concatenate((np.arange(1.0, 40.0), np.arange(160.0, 200.0)))
    true = 300.0 + rate * 1.003 * time_s
    reading = np.mod(true, 360.0)
    reading[20] = 123.0
    encoder = unwrap(time_s, reading, rate, 1.0)
    assert encoder.angle_deg - encoder.angle_deg[0] == pytest.approx(true - true[0], abs=1e-6)
    assert encoder.mean_rate_deg_per_s == pytest.approx(1.003 * rate)
    assert not encoder.reversed


def test_the_same_data_give_the_same_numbers() -> None:
    assert analyse(record()).estimates == analyse(record()).estimates
