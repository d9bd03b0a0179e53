"""The analysis of an accelerometer's magnetic sensitivity: truth, nuisances, poor data, honesty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accelerometer_records import (
    SIX_FIELDS_T,
    TRUTH,
    codes,
    estimate,
    off_in_u,
    points,
    record,
)
from scipy.special import stdtrit

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.outlook import expected_uncertainty
from procedures.accelerometer_magnetic_sensitivity.parameters import AnalysisSettings

WARM_UP_TIME_S = 1500.0


def drift(rows: int, seed: int = 0) -> np.ndarray:
    """Return 20 uV/h and a warm-up of 30 uV over the rows' times."""
    time_s = 10.0 * np.arange(rows)
    return 20e-6 * time_s / 3600.0 - 30e-6 * np.exp(-time_s / WARM_UP_TIME_S)


@pytest.mark.parametrize("planes", [("io",), ("io", "ip"), ("io", "ip", "op"), ("op",), ("level",)])
def test_without_noise_the_truth_comes_back(planes: tuple[str, ...]) -> None:
    analysis = analyse(record(0, planes, 9, SIX_FIELDS_T, noise_V=1e-12))
    for one in analysis.estimates:
        if one.value is not None:
            true = sum(share * TRUTH[name] for name, share in one.extra["terms"].items())
            assert one.value == pytest.approx(true, abs=2e-9), one.name


def test_noise_is_answered_by_uncertainties_that_are_the_bound() -> None:
    dataset = record(1)
    analysis = analyse(dataset)
    bound = expected_uncertainty(*points(("io", "ip"), 9, (-0.05, 0.0, 0.05)), 3e-6)
    for name, u in bound.standard_uncertainty.items():
        assert u is not None
        stated = estimate(analysis, name).standard_uncertainty
        # A linear drift that may be there adds to what resembles it.
        assert stated is not None
        assert 0.7 < stated / u < 1.8
    assert max(off_in_u(analysis).values()) < 3.5
    assert codes(analysis) == {"not-identifiable"}
    assert analysis.noise_V == pytest.approx(3e-6, rel=0.25)


def test_folded_coefficients_have_no_value_and_kept_ones_say_what_they_stand_for() -> None:
    analysis = analyse(record(2))
    assert estimate(analysis, "Kpp").value is None
    assert estimate(analysis, "K0").extra["terms"] == {"K0": 1.0, "Kpp": 1.0}
    flag = next(flag for flag in analysis.flags if flag.code == "not-identifiable")
    assert flag.details["coefficients"] == ["K0", "Kii", "Koo", "Kpp"]
    assert "K0 + Kpp" in flag.message


@pytest.mark.campaign
def test_95_percent_intervals_hold_the_truth_95_times_in_100() -> None:
    inside, total = 0, 0
    for seed in range(100):
        analysis = analyse(record(seed))
        for name, off in off_in_u(analysis).items():
            freedom = estimate(analysis, name).degrees_of_freedom
            assert freedom is not None
            inside += off <= stdtrit(freedom, 0.975)
            total += 1
    # The twelve of a record are not independent: about 0.8 % of standard error.
    assert 0.925 <= inside / total <= 0.975


@pytest.mark.parametrize("planes", [("io",), ("io", "ip", "op")])
def test_an_encoder_offset_is_found_and_costs_nothing_else(planes: tuple[str, ...]) -> None:
    analysis = analyse(record(3, planes, 12, SIX_FIELDS_T, offset_arcsec=10.0))
    found = {one.name: one for one in analysis.nuisances}
    offset = found["encoder offset"]
    assert offset.unit == "arcsec"
    assert abs(offset.value - 10.0) < 4 * offset.standard_uncertainty < 1.5
    assert max(off_in_u(analysis).values()) < 3.7


def test_a_large_encoder_offset_is_followed_beyond_the_first_order() -> None:
    analysis = analyse(record(3, ("io", "ip"), 12, SIX_FIELDS_T, offset_arcsec=3600.0))
    assert analysis.nuisances[0].value == pytest.approx(3600.0, abs=1.0)
    assert max(off_in_u(analysis).values()) < 3.7


def test_misalignment_and_encoder_offset_are_told_apart_in_three_planes_only() -> None:
    tilted = (5e-4, -3e-4)
    dataset = record(4, ("io", "ip", "op"), 12, offset_arcsec=10.0, misalignment=tilted)
    found = {one.name: one.value for one in analyse(dataset).nuisances}
    assert found["encoder offset"] == pytest.approx(10.0, abs=0.6)
    assert found["Ko"] == pytest.approx(tilted[0], abs=4e-6)
    assert found["Kp"] == pytest.approx(tilted[1], abs=4e-6)
    two = analyse(record(4, ("io", "ip"), 12, misalignment=tilted))
    assert two.not_separable == ("Kp",)
    assert max(off_in_u(two).values()) < 3.7


def test_drift_and_warm_up_are_removed_with_zero_mean_and_said() -> None:
    rows = 8 * 54
    slow = drift(rows)
    dataset = record(5, ("io", "ip"), 72, (-0.05, 0.0, 0.05), drift_V=slow, offset_arcsec=10.0)
    analysis = analyse(dataset)
    truth = {**TRUTH, "K0": TRUTH["K0"] + float(slow.mean())}
    assert max(off_in_u(analysis, truth).values()) < 3.7
    assert codes(analysis) == {"not-identifiable", "drift-removed"}
    assert analysis.drift_order >= 2


def test_temperature_terms_are_those_at_the_mean_temperature() -> None:
    count = len(points(("io", "ip"), 12, SIX_FIELDS_T)[0])
    warm = 23.0 + np.sin(np.arange(count) / 9.0)
    dataset = record(
        6, ("io", "ip"), 12, SIX_FIELDS_T, temperature_degC=warm, K0_per_K=5e-5, Ki_per_K=1e-4
    )
    analysis = analyse(dataset)
    found = {one.name: one.value for one in analysis.nuisances}
    assert found["K0_T"] == pytest.approx(5e-5, abs=3e-6)
    assert found["Ki_T"] == pytest.approx(1e-4, abs=3e-6)
    assert max(off_in_u(analysis).values()) < 3.7


def test_a_steady_temperature_adds_no_term() -> None:
    generator = np.random.default_rng(0)
    steady = 23.0 + 1e-3 * generator.standard_normal(54)
    names = {one.name for one in analyse(record(7, temperature_degC=steady)).nuisances}
    assert not names & {"K0_T", "Ki_T"}


@pytest.mark.campaign
def test_outliers_missing_rows_and_all_the_rest_together() -> None:
    far = 0.0
    for seed in range(5):
        dataset = record(
            seed,
            ("io", "ip", "op"),
            48,
            (-0.05, 0.0, 0.05),
            drift_V=drift(432),
            offset_arcsec=10.0,
        )
        generator = np.random.default_rng([seed, 1])
        wild = generator.random(432) < 0.03
        output = dataset.output_V + np.where(wild, generator.choice([-1, 1], 432) * 2e-3, 0.0)
        there = generator.random(432) >= 0.08
        fields = ("time_s", "plane", "theta_deg", "theta_commanded_deg")
        fields += ("field_T", "field_commanded_T")
        kept = {name: getattr(dataset, name)[there] for name in fields}
        damaged = replace(dataset, output_V=output[there], **kept)
        analysis = analyse(damaged)
        rejected = [one.row for one in analysis.left_out]
        assert set(np.flatnonzero(wild[there])) <= set(rejected)
        assert len(rejected) <= int(wild[there].sum()) + 1
        assert codes(analysis) >= {"outliers-rejected", "gap", "drift-removed"}
        truth = {**TRUTH, "K0": TRUTH["K0"] + float(drift(432)[there].mean())}
        far = max(far, *off_in_u(analysis, truth).values())
    assert far < 4.2


def test_an_outlier_in_a_small_plan_is_found() -> None:
    dataset = record(8, ("io",), 12, (0.0, 0.02, 0.04))
    for row in (0, 17, 35):
        output = dataset.output_V.copy()
        output[row] += 1e-4
        analysis = analyse(replace(dataset, output_V=output))
        assert [one.row for one in analysis.left_out] == [row]
        assert max(off_in_u(analysis).values()) < 3.7


def test_the_published_solution_stands_in_spite_of_overloads() -> None:
    dataset = record(9)
    output = dataset.output_V.copy()
    output[[3, 20, 7]] = [9.9e37, -9.9e37, np.nan]
    analysis = analyse(replace(dataset, output_V=output))
    assert all(one.value is not None for one in analysis.published if one.name != "Kpp")


def test_a_wild_reading_of_field_temperature_or_angle_bends_nothing() -> None:
    room_degC = 23.0 + 0.002 * np.random.default_rng(1).standard_normal(144)
    dataset = record(10, ("io", "ip"), 12, SIX_FIELDS_T, temperature_degC=room_degC)
    assert dataset.temperature_degC is not None
    field, warm = dataset.field_T.copy(), dataset.temperature_degC.copy()
    theta = dataset.theta_deg.copy()
    field[11], warm[40], theta[77] = 5.0, 900.0, theta[77] + 12.0
    damaged = replace(dataset, field_T=field, temperature_degC=warm, theta_deg=theta)
    analysis = analyse(damaged)
    assert [one.row for one in analysis.left_out] == [11, 40, 77]
    assert max(off_in_u(analysis).values()) < 3.7


@pytest.mark.parametrize("field_gain", [0.99, 1.003])
def test_terms_are_those_of_the_measured_field(field_gain: float) -> None:
    for seed in range(2):
        one = record(seed, ("io", "ip"), 24, (0.0, 0.05), noise_V=1e-6, field_gain=field_gain)
        analysis = analyse(one)
        km = estimate(analysis, "Km")
        assert km.extra["terms"]["Kmm"] == pytest.approx(0.05 * field_gain, rel=1e-4)
        assert off_in_u(analysis)["Km"] < 4.0
        moved = [f for f in analysis.flags if f.code == "field-differs-from-commanded"]
        assert ["Km"] in [flag.details.get("coefficients") for flag in moved]
        wanting = next(f for f in analysis.flags if f.code == "not-identifiable")
        assert wanting.details["coefficients"] == ["K0", "Kii", "Koo", "Kpp", "Km", "Kmm"]


def test_terms_stay_those_of_the_plan_where_the_field_was_as_commanded() -> None:
    analysis = analyse(record(0, ("io", "ip"), 24, (0.0, 0.05), noise_V=1e-6))
    assert estimate(analysis, "Km").extra["terms"] == {"Km": 1.0, "Kmm": 0.05}
    assert "field-differs-from-commanded" not in codes(analysis)


def test_ranges_of_the_voltmeter_weigh_by_their_noise() -> None:
    dataset = record(12, ("io", "ip"), 24, SIX_FIELDS_T)
    generator = np.random.default_rng(2)
    coarse = np.abs(np.sin(np.radians(dataset.theta_deg))) > 0.8
    output = dataset.output_V + np.where(coarse, 30e-6 * generator.standard_normal(288), 0.0)
    noisy = replace(dataset, output_V=output)
    plain = analyse(noisy)
    weighed = analyse(replace(noisy, noise_group=coarse.astype(np.int64)))
    one, other = estimate(plain, "Km"), estimate(weighed, "Km")
    assert one.standard_uncertainty is not None and other.standard_uncertainty is not None
    assert other.standard_uncertainty < 0.4 * one.standard_uncertainty
    assert max(off_in_u(weighed).values()) < 3.7


def test_type_b_sensitivities_are_the_derivatives_of_the_values() -> None:
    dataset = record(14, noise_V=1e-12)
    base = analyse(dataset)
    moved = {
        "field_gain": (replace(dataset, field_T=dataset.field_T * 1.001), 1e-3),
        "field_offset_T": (replace(dataset, field_T=dataset.field_T + 1e-5), 1e-5),
        "voltage_gain": (replace(dataset, output_V=dataset.output_V * 1.001), 1e-3),
        "voltage_offset_V": (replace(dataset, output_V=dataset.output_V + 1e-5), 1e-5),
    }
    for name, (changed, step) in moved.items():
        other = analyse(changed)
        for one in base.estimates:
            if one.value is None:
                continue
            now = estimate(other, one.name).value
            assert now is not None
            expected = one.sensitivities.get(name, 0.0)
            slope = (now - one.value) / step
            assert slope == pytest.approx(expected, rel=5e-3, abs=2e-4), (name, one.name)


def test_thresholds_are_the_callers() -> None:
    dataset = record(17, field_gain=1.008)
    assert "field-differs-from-commanded" not in codes(analyse(dataset))
    strict = analyse(dataset, AnalysisSettings(field_differs_from_commanded=0.005))
    assert "field-differs-from-commanded" in codes(strict)


def test_the_same_data_give_the_same_numbers() -> None:
    assert analyse(record(18)).estimates == analyse(record(18)).estimates
