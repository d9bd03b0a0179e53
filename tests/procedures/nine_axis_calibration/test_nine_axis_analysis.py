"""The analysis of a nine-axis sensor: truth, heading, rates, wrong positions, poor data."""

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
from procedures.nine_axis_calibration.dataset import NineAxisDataset, TurnRecord
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


def test_a_table_far_off_its_rate_is_said_to_be() -> None:
    analysis = analyse(record(Setting(table_ppm=20000.0)), allan=False)
    assert "rate-differs-from-commanded" in codes(analysis)
    assert value(analysis, "scale_factor", "Y") == pytest.approx(SCALE[1], abs=2e-6)


def test_part_turns_are_flagged_and_their_earth_rate_taken_off() -> None:
    dataset = record(Setting(noise=0.01))
    cut = tuple(cut_off(one, 0.6) for one in dataset.turns)
    analysis = analyse(replace(dataset, turns=cut), allan=False)
    flag = next(flag for flag in analysis.flags if flag.code == "part-turns")
    assert set(flag.details["rates"]) >= {1.0, 5.0}  # type: ignore[call-overload]
    assert max(off_in_u(analysis).values()) < 4.0


def cut_off(one: TurnRecord, part: float) -> TurnRecord:
    end = int(part * len(one.time_s))
    return replace(
        one,
        time_s=one.time_s[:end],
        rate_deg_per_s=one.rate_deg_per_s[:end],
        encoder_deg=one.encoder_deg[:end],
    )


def test_with_the_turned_axis_alone_there_are_no_misalignments() -> None:
    analysis = analyse(record(Setting(alone=True)), allan=False)
    assert analysis.estimate("misalignment", "XY").value is None
    flag = next(flag for flag in analysis.flags if flag.code == "not-identifiable")
    assert len(flag.details["coefficients"]) == 6  # type: ignore[arg-type]
    assert off_in_u(analysis)["scale_factor", "X"] < 3.5


@pytest.mark.parametrize(("position", "really"), [(1, 2), (2, 1), (3, 1), (1, 4), (2, 5), (3, 6)])
def test_a_wrong_position_is_found_and_left_out(position: int, really: int) -> None:
    analysis = analyse(record(Setting(stands_as={position: really})), allan=False)
    flags = [flag for flag in analysis.flags if flag.code == "wrong-position"]
    assert [flag.details["position"] for flag in flags] == [position]
    assert isinstance(flags[0].details["position"], int)
    assert f"as in position {really}" in flags[0].message
    for axis, name in enumerate("XYZ"):
        assert abs(value(analysis, "bias", name) - BIAS[axis]) < 4 * total_u(analysis, "bias", name)


def test_two_positions_in_the_place_of_each_other_are_both_found() -> None:
    analysis = analyse(record(Setting(stands_as={1: 2, 2: 1})), allan=False)
    wrong = [f.details["position"] for f in analysis.flags if f.code == "wrong-position"]
    assert wrong == [1, 2]
    assert max(off_in_u(analysis).values()) < 4.0


def test_one_position_is_judged_alone_before_it_is_accepted() -> None:
    for position in (1, 2, 3):
        rates = expected_rates(position, LATITUDE_DEG) + BIAS
        gravity = gravity_pattern(position)
        assert check_pose(position, rates, gravity, LATITUDE_DEG).right
        other = position % 3 + 1
        wrong = check_pose(other, rates, gravity, LATITUDE_DEG)
        assert not wrong.right
        assert wrong.stands_as == position
        assert wrong.why


def test_a_skipped_position_costs_uncertainty_and_the_published_mean() -> None:
    analysis = analyse(record(Setting(positions=(1, 3))), allan=False)
    published = {one.axis: one.value for one in analysis.published if one.name == "bias"}
    assert published["Y"] is None
    assert {"position-missing", "published-rule-without-data"} <= codes(analysis)
    assert max(off_in_u(analysis).values()) < 3.5


def test_wild_and_missing_samples_leave_the_truth() -> None:
    dataset = record(Setting(3, static_s=300))
    generator = np.random.default_rng(5)
    static = []
    for one in dataset.static:
        rate = one.rate_deg_per_h.copy()
        rate[generator.random(len(rate)) < 0.05] += 500.0
        there = generator.random(len(rate)) > 0.08
        static.append(
            replace(
                one,
                time_s=one.time_s[there],
                rate_deg_per_h=rate[there],
                acceleration_g=one.acceleration_g[there],
            )
        )
    turns = []
    for turn in dataset.turns:
        rate = turn.rate_deg_per_s.copy()
        rate[generator.random(len(rate)) < 0.05] += 0.5
        encoder = turn.encoder_deg.copy()
        encoder[len(encoder) // 2] += 77.0
        turns.append(replace(turn, rate_deg_per_s=rate, encoder_deg=encoder))
    analysis = analyse(replace(dataset, static=tuple(static), turns=tuple(turns)), allan=False)
    assert {"outliers-rejected", "gap"} <= codes(analysis)
    assert max(off_in_u(analysis).values()) < 4.0


def test_samples_that_only_repeat_one_before_are_left_out() -> None:
    dataset = record(Setting(3, static_s=300))
    first, *others = dataset.static
    rate, force = first.rate_deg_per_h.copy(), first.acceleration_g.copy()
    rate[100:], force[100:] = rate[100] + 2.0, force[100]
    frozen = replace(first, rate_deg_per_h=rate, acceleration_g=force)
    analysis = analyse(replace(dataset, static=(frozen, *others)), allan=False)
    (flag,) = [flag for flag in analysis.flags if flag.code == "frozen"]
    assert flag.details == {"count": 199, "at_rest": 199, "turning": 0}
    assert max(off_in_u(analysis).values()) < 4.0


def saturated(dataset: NineAxisDataset, at: float, known: float | None) -> NineAxisDataset:
    clipped = tuple(
        replace(one, rate_deg_per_s=np.clip(one.rate_deg_per_s, -at, at)) for one in dataset.turns
    )
    return replace(dataset, turns=clipped, largest_rate_deg_per_s=known)


@pytest.mark.parametrize("known", [80.0, None])
def test_saturated_records_are_left_out_whether_or_not_the_range_is_known(
    known: float | None,
) -> None:
    analysis = analyse(saturated(record(), 80.0, known), allan=False)
    flag = next(flag for flag in analysis.flags if flag.code == "overload")
    assert set(flag.details["rates"]) == {100.0, -100.0}  # type: ignore[call-overload]
    assert "one-sense-only" in codes(analysis) or len(analysis.axes[0].commanded) == 4  # type: ignore[union-attr]
    for axis, name in enumerate("XYZ"):
        assert value(analysis, "scale_factor", name) == pytest.approx(SCALE[axis], abs=8e-6)


def test_fewer_than_five_rates_are_analysed_and_said() -> None:
    analysis = analyse(record(Setting(rates=(5.0, 50.0))), allan=False)
    assert "outside-published-range" in codes(analysis)
    assert off_in_u(analysis)["scale_factor", "X"] < 3.5


def test_a_wandering_bias_widens_its_uncertainty() -> None:
    dataset = record(Setting(static_s=600))
    slow = 0.4 * np.sin(np.arange(600) / 90.0)
    static = tuple(
        replace(one, rate_deg_per_h=one.rate_deg_per_h + slow[:, None]) for one in dataset.static
    )
    analysis = analyse(replace(dataset, static=static), allan=False)
    assert "bias-wanders" in codes(analysis)
    assert total_u(analysis, "bias", "X") > 0.1


def test_nothing_to_measure_gives_nulls_and_no_error() -> None:
    dataset = record(Setting(positions=()))
    analysis = analyse(dataset, allan=False)
    assert analysis.estimate("bias", "X").value is None
    assert "not-identifiable" in codes(analysis)
    one_sense = tuple(one for one in dataset.turns if one.commanded_deg_per_s > 0)
    analysis = analyse(replace(dataset, turns=one_sense), allan=False)
    assert analysis.estimate("scale_factor", "X").value is None


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
