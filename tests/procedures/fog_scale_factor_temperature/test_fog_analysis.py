"""A gyro's scale factor over temperature: truth, bias, wild turns, order, honesty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fog_records import CURVES, NOISE_DEG, knocked, only, other, quartic, record

from procedures.fog_scale_factor_temperature.analysis import FogAnalysis, analyse
from procedures.fog_scale_factor_temperature.curve import Band, Curve
from procedures.fog_scale_factor_temperature.solution import AxisFit

WAITING = (360, 0)


def fit_of(analysis: FogAnalysis, axis: str = "x") -> tuple[AxisFit, Curve]:
    fit = analysis.fits[axis]
    assert fit.curve is not None
    return fit, fit.curve


def codes(analysis: FogAnalysis) -> set[str]:
    return {flag.code for flag in analysis.flags}


def off_ppm(curve: Curve, truth: object = quartic) -> np.ndarray:
    heat = curve.temperatures_degC(21)
    return curve.error_ppm(heat) - truth(heat)  # type: ignore[operator, no-any-return]


@pytest.mark.parametrize("turns", [(360, -360), (360, -360, -360, 360), WAITING, (-360, 360)])
def test_without_noise_the_curves_come_back_whatever_the_bias(turns: tuple[int, ...]) -> None:
    dataset = record(0, turns, axes=("x", "y", "z"), bias_deg_per_h=3.0, noise_deg=1e-8)
    analysis = analyse(dataset)
    for axis, truth in CURVES.items():
        fit, curve = fit_of(analysis, axis)
        assert fit.paired
        assert fit.bias_deg_per_h == pytest.approx(3.0, abs=0.01)
        assert np.abs(off_ppm(curve, truth)).max() < 0.01
    assert fit_of(analysis, "x")[1].order == 4
    assert fit_of(analysis, "y")[1].order == 2


def test_turns_of_one_sense_take_the_bias_for_scale_factor_and_say_by_how_much() -> None:
    dataset = record(0, (360,), bias_deg_per_h=1.0, noise_deg=1e-8)
    fit, curve = fit_of(analyse(dataset))
    assert not fit.paired
    assert fit.bias_deg_per_h is None
    one_deg_per_h = 47.0 / 3600.0 / 360.0 * 1e6
    assert off_ppm(curve) == pytest.approx(one_deg_per_h, abs=0.01)
    assert curve.error_by_bias_ppm(np.array([20.0])) == pytest.approx(one_deg_per_h, abs=1e-6)
    # A bias moves the whole curve alike: to hold all of it is no more than to hold one point.
    band, heat = Band(curve, 1.0), np.array([-30.0, 20.0])
    assert band.whole_factor == pytest.approx(1.96, abs=0.01)
    assert band.expanded_ppm(heat) == pytest.approx(1.96 * one_deg_per_h, rel=0.01)


def test_turns_of_the_negative_sense_alone_have_the_scale_factor_with_its_sign() -> None:
    dataset = record(0, (-360,), bias_deg_per_h=0.0, noise_deg=1e-8)
    assert np.abs(off_ppm(fit_of(analyse(dataset))[1])).max() < 0.01


@pytest.mark.campaign
def test_noise_is_answered_by_the_bound_and_by_intervals_that_hold_the_truth() -> None:
    inside, whole, ratios, orders = [], [], [], []
    for seed in range(60):
        fit, curve = fit_of(analyse(record(seed, walk=0.05)))
        heat = curve.temperatures_degC(21)
        band = Band(curve)
        inside.append(np.mean(np.abs(off_ppm(curve)) <= band.expanded_ppm(heat)))
        whole.append(np.all(np.abs(off_ppm(curve)) <= band.whole_ppm(heat)))
        columns = curve.columns(fit.turns.temperature_degC)
        bound = np.linalg.inv(columns.T @ columns)
        there = curve.columns(heat)
        limit = np.sqrt(np.einsum("ij,jk,ik->i", there, bound, there))
        ratios.append(np.mean(off_ppm(curve) ** 2) / np.mean(limit**2))
        orders.append(curve.order)
    assert 0.90 <= np.mean(inside) <= 0.985
    assert 0.88 <= np.mean(whole) < 1.0
    assert np.sqrt(np.mean(ratios)) < 1.2
    assert np.mean(np.array(orders) == 4) >= 0.9


def test_wild_and_missing_turns_are_told_one_by_one() -> None:
    dataset = record(3, axes=("x", "y"), walk=0.05)
    wild = [0, 41, 42, 90, 215]
    generator = np.random.default_rng(2)
    there = generator.random(len(dataset.turns)) > 0.05
    there[wild] = True
    spoilt = only(knocked(dataset, wild, 0.06), there)
    moved = np.cumsum(there)[wild] - 1
    analysis = analyse(spoilt)
    flags = [flag for flag in analysis.flags if flag.code == "outliers-rejected"]
    assert sorted(row for flag in flags for row in flag.details["rows"]) == sorted(moved)  # type: ignore[attr-defined]
    for axis, truth in (("x", quartic), ("y", other)):
        assert np.abs(off_ppm(fit_of(analysis, axis)[1], truth)).max() < 1.6


def test_a_pair_with_a_knocked_turn_keeps_its_good_one() -> None:
    fit, _ = fit_of(analyse(knocked(record(1, walk=0.05), [51], 0.05)))
    assert [int(row) for row in fit.turns.rows[~fit.kept]] == [51]


def test_wild_turns_at_the_end_of_the_range_are_not_taken_for_the_curve() -> None:
    for rows in ([0, 1, 2], [105, 106, 107]):
        fit, curve = fit_of(analyse(knocked(record(1), rows, 0.1)))
        assert [int(row) for row in fit.turns.rows[~fit.kept]] == rows
        assert curve.order == 4


def test_a_wild_temperature_is_no_turn_at_that_temperature() -> None:
    dataset = record(1)
    heat = dataset.turns.temperature_after_degC.copy()
    heat[30] = 850.0
    turns = replace(dataset.turns, temperature_after_degC=heat)
    fit, curve = fit_of(analyse(replace(dataset, turns=turns)))
    assert [int(row) for row in fit.turns.rows[~fit.kept]] == [30]
    assert curve.domain_degC[1] < 60.0


def test_a_real_feature_of_the_curve_is_no_heap_of_wild_turns() -> None:
    def bumpy(heat: np.ndarray) -> np.ndarray:
        return quartic(heat) + 300.0 * np.exp(-0.5 * ((heat - 5.0) / 9.0) ** 2)

    fit, curve = fit_of(analyse(record(0, curves={"x": bumpy})))
    assert bool(fit.kept.all())
    assert curve.order >= 12
    assert np.abs(off_ppm(curve, bumpy)).max() < 5.0


def test_neighbouring_sets_that_all_disagree_are_rather_a_feature_than_wild_turns() -> None:
    def bumpy(heat: np.ndarray) -> np.ndarray:
        return quartic(heat) + 300.0 * np.exp(-0.5 * ((heat - 5.0) / 2.5) ** 2)

    analysis = analyse(record(0, curves={"x": bumpy}))
    (flag,) = (flag for flag in analysis.flags if flag.code == "model-too-stiff")
    low, high = flag.details["between_degC"]  # type: ignore[misc]
    assert -5.0 < low < 5.0 < high < 15.0


def test_an_encoders_angles_are_no_two_the_same_and_still_one_sense() -> None:
    for turns, paired in (((360,), False), ((360, -360), True), (WAITING, True)):
        dataset = record(0, turns, noise_deg=1e-8)
        table = dataset.turns
        generator = np.random.default_rng(0)
        off = 2e-4 * generator.standard_normal(len(table))
        after = table.attitude_after_deg + off[:, None]
        moved = replace(table, commanded_deg=table.commanded_deg + off, attitude_after_deg=after)
        fit, curve = fit_of(analyse(replace(dataset, turns=moved)))
        assert fit.paired is paired
        assert np.abs(off_ppm(curve)).max() < (0.1 if paired else 1.0)


def test_coarse_headings_throw_no_honest_turn_out() -> None:
    dataset = record(0, noise_deg=1e-4)
    turns = dataset.turns
    coarse = {
        name: np.round(getattr(turns, name), 2)
        for name in ("attitude_before_deg", "attitude_after_deg")
    }
    rounded = replace(dataset, turns=replace(turns, **coarse), heading_resolution_deg=0.01)
    fit, curve = fit_of(analyse(rounded))
    assert bool(fit.kept.all())
    assert fit.noise_ppm == pytest.approx(0.01 / np.sqrt(6.0) / 360e-6, rel=0.3)
    assert np.abs(off_ppm(curve)).max() < 12.0


def test_what_a_wandering_bias_takes_is_found_from_the_data() -> None:
    walks = [fit_of(analyse(record(seed, walk=0.08)))[0] for seed in range(8)]
    sizes = [fit.walk_deg_per_h_per_sqrt_h for fit in walks]
    assert np.mean(sizes) == pytest.approx(0.08, rel=0.3)  # type: ignore[arg-type]
    noises = [fit.noise_ppm for fit in walks]
    assert np.mean(noises) == pytest.approx(NOISE_DEG / 360e-6, rel=0.1)  # type: ignore[arg-type]


def test_a_curve_is_less_sure_where_sets_are_missing() -> None:
    dataset = record(0)
    number = dataset.turns.set_number
    _, curve = fit_of(analyse(only(dataset, (number < 20) | (number > 27))))
    within = curve.standard_uncertainty_ppm(np.array([2.0, 30.0]))
    assert within[0] > within[1]


@pytest.mark.parametrize(("sets", "most"), [(4, 1), (6, 3), (9, 4)])
def test_few_temperatures_carry_a_low_order_only(sets: int, most: int) -> None:
    _, curve = fit_of(analyse(record(0, sets=sets)))
    assert curve.order <= most


def test_nothing_is_said_outside_the_range_of_the_turns() -> None:
    dataset = replace(record(0, last_degC=10.0), reference_temperature_degC=20.0)
    analysis = analyse(dataset)
    assert "extrapolation" in codes(analysis)
    _, curve = fit_of(analysis)
    ends = curve.error_ppm(np.array([curve.domain_degC[1], 100.0]))
    assert ends[0] == ends[1]


def test_the_published_rule_takes_bias_and_wild_turns_for_scale_factor() -> None:
    dataset = knocked(record(0, bias_deg_per_h=0.3), [40], 0.1)
    analysis = analyse(dataset)
    published = analysis.published["x"]
    assert published is not None
    assert published.order == 4
    assert np.abs(off_ppm(published)).max() > 10.0
    assert np.abs(off_ppm(fit_of(analysis)[1])).max() < 1.5


def test_a_curve_is_the_same_whatever_else_was_turned() -> None:
    whole = fit_of(analyse(record(0, axes=("x", "y", "z"))), "y")[1]
    dataset = record(0, axes=("x", "y", "z"))
    alone = fit_of(analyse(only(dataset, dataset.turns.axis == "y")), "y")[1]
    assert alone.coefficients_ppm == pytest.approx(whole.coefficients_ppm)


def test_scaled_polynomials_are_well_conditioned() -> None:
    _, curve = fit_of(analyse(record(0)))
    assert np.linalg.cond(curve.columns(np.linspace(-38.0, 59.0, 54))) ** 2 < 10.0
