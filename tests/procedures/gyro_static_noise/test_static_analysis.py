"""The noise of a gyro at rest recovered: bounds, coverage, long gaps, repeatability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from static_records import DEVICES, bound_of_squares, measured_squares, records, true_squares

from procedures.estimation.direction import Direction
from procedures.estimation.rate_spectrum import (
    coefficients,
    covariances,
    noise_variances,
    variances,
)
from procedures.gyro_static_noise.analysis import StaticAnalysis, analyse
from procedures.gyro_static_noise.dataset import Array, Record, StaticDataset
from station.findings import CONTRADICTS

FOG, RLG = DEVICES["FOG"], DEVICES["RLG"]
SAMPLES = 3600


def value(analysis: StaticAnalysis, name: str) -> float:
    found = analysis.estimate(name, "IA").value
    assert found is not None
    return found


def value_or_nan(analysis: StaticAnalysis, name: str) -> float:
    values = [estimate.value for estimate in analysis.estimates if estimate.name == name]
    return float("nan") if values[0] is None else values[0]


def changed(dataset: StaticDataset, rate: Array, keep: Array | None = None) -> StaticDataset:
    """Return a dataset whose first record has these rates, or those of the kept places."""
    first, *rest = dataset.records
    places = np.ones(len(rate), dtype=bool) if keep is None else keep.astype(bool)
    fresh = replace(first, time_s=first.time_s[places], rate_deg_per_h=rate[places])
    return replace(dataset, records=(fresh, *rest))


@pytest.fixture(scope="module")
def fog() -> StaticDataset:
    return records(np.random.default_rng(3), FOG, [SAMPLES, 600, 600])


def test_variances_are_those_of_the_covariance_matrix() -> None:
    transform = coefficients(np.eye(60))
    for one in covariances(60, 0.5):
        exact = np.diag(transform @ toeplitz(one) @ transform.T)
        assert np.allclose(variances(one), exact, rtol=1e-9)
    assert (noise_variances(60, 0.5) > 0.0).all()


@pytest.mark.parametrize("device", ["FOG", "RLG"])
def test_errors_reach_the_bound_and_intervals_cover(device: str) -> None:
    found = measured_squares(DEVICES[device], 10, 1200)
    bound = bound_of_squares(DEVICES[device], 1200)
    rms = np.sqrt(np.mean(found.errors**2, axis=0)) / bound
    assert (rms < 1.8).all(), rms
    assert found.covered.mean() > 0.85
    assert found.lines == 0


def test_a_long_gap_divides_the_record(fog: StaticDataset) -> None:
    keep = np.ones(SAMPLES)
    keep[1800:2200] = 0.0
    rate = fog.records[0].rate_deg_per_h.copy()
    rate[2200:] += 5.0  # another bias after it: each part has its own mean
    found = analyse(changed(fog, rate, keep))
    assert value(found, "angle_random_walk") == pytest.approx(0.005, rel=0.05)
    assert value(found, "rate_random_walk") < 0.3
    fit = found.axes[0].fit
    assert fit is not None
    assert [len(one) for one in fit.pieces] == [1800, 1400]


def test_a_record_that_is_frozen_whole_gives_null(fog: StaticDataset) -> None:
    alone = replace(fog, records=fog.records[:1])
    found = analyse(changed(alone, np.full((SAMPLES, 1), 9.6)))
    assert all(estimate.value is None for estimate in found.estimates)
    assert "not-identifiable" in {flag.code for flag in found.flags}


def test_what_a_run_without_a_finished_record_lacks_is_flagged_whole(fog: StaticDataset) -> None:
    found = analyse(replace(fog, records=()))
    (flag,) = [flag for flag in found.flags if flag.code == "not-identifiable"]
    assert {estimate.name for estimate in found.estimates} == set(flag.details["coefficients"])


def test_a_switch_on_that_is_frozen_whole_is_flagged_and_leaves_no_repeatability(
    fog: StaticDataset,
) -> None:
    first, second = (fog.records[0], fog.records[0])
    stands = replace(second, rate_deg_per_h=np.full_like(second.rate_deg_per_h, 9.6))
    found = analyse(replace(fog, records=(first, stands)))
    assert np.isnan(value_or_nan(found, "bias_repeatability"))
    flags = {flag.code: flag for flag in found.flags}
    assert flags["frozen"].details["count"] == len(second.rate_deg_per_h)
    assert flags["not-identifiable"].details["coefficients"] == ["bias_repeatability"]


def test_repeatability_is_the_switch_ons_own() -> None:
    quiet = {**FOG, "B": 0.0, "K": 0.0, "switch_on": 0.0}
    found = analyse(records(np.random.default_rng(6), quiet, [SAMPLES, *[600] * 6]))
    repeats = found.estimate("bias_repeatability", "IA")
    assert repeats.value is not None
    assert repeats.standard_uncertainty is not None
    assert repeats.value < 3.0 * repeats.standard_uncertainty  # the plain spread is white noise
    published = next(one for one in found.published if one.name == "bias_repeatability")
    assert published.value is not None
    assert published.value > repeats.value


def test_a_ramp_and_a_line_are_in_the_uncertainty_of_the_stability() -> None:
    """Where they rule the spread of 10 s means it is known as well as they are."""
    near = []
    for seed in range(6):
        dataset = records(np.random.default_rng(seed), RLG, [SAMPLES])
        time_s = np.arange(SAMPLES) - 0.5 * SAMPLES
        drift = 0.1 * time_s / 3600.0 + 0.1 * np.sin(2.0 * np.pi * time_s / 300.0)
        rate = dataset.records[0].rate_deg_per_h + drift[:, None]
        estimate = analyse(changed(dataset, rate)).estimate("bias_stability", "IA")
        noise = true_squares(RLG) @ noise_variances(SAMPLES // 10, 10.0)
        means = drift.reshape(-1, 10).mean(axis=1)
        true = np.sqrt(noise.mean() + np.var(means))
        assert estimate.value is not None and estimate.standard_uncertainty
        near.append((estimate.value - true) / estimate.standard_uncertainty)
    assert float(np.sqrt(np.mean(np.square(near)))) < 2.0


def test_roundings_that_follow_one_another_are_no_lines() -> None:
    gyro = {**DEVICES["RLG-coarse"], "N": 0.0003, "pulse": 1.03}
    found = analyse(records(np.random.default_rng(6), gyro, [SAMPLES, 600, 600]))
    codes = {flag.code for flag in found.flags}
    assert "coarse-output" in codes
    assert "periodic" not in codes


def test_what_moves_all_switch_ons_alike_is_in_the_uncertainty_of_the_bias() -> None:
    """A tail of the warm-up does not show in the spread of switch-ons, nor does a walk."""
    gyro = {**RLG, "switch_on": 0.0005}
    made = records(np.random.default_rng(4), gyro, [SAMPLES, 600, 600, 600])
    warm = tuple(
        replace(
            one,
            rate_deg_per_h=one.rate_deg_per_h
            + 0.05 * np.exp(-(one.time_s - one.time_s[0]) / 700.0)[:, None],
        )
        for one in made.records
    )
    at_hours = tuple(
        replace(one, on_s=5.0 * 3600.0 * number) for number, one in enumerate(made.records)
    )
    plain, tail, walk = (
        analyse(replace(made, records=own)).estimate("bias", "IA").standard_uncertainty
        for own in (made.records, warm, at_hours)
    )
    assert plain is not None and tail is not None and walk is not None
    assert tail > 0.02
    assert walk > 2.0 * plain


def test_exchanged_axes_of_a_triad_are_named() -> None:
    directions = {
        "X": Direction(0.0, 0.0),
        "Y": Direction(np.pi / 2.0, 0.0),
        "Z": Direction(0.0, np.pi / 2.0),
    }
    latitude = float(np.deg2rad(39.9))
    earth = np.array([axis.earth_deg_per_h(latitude) for axis in directions.values()])
    rng = np.random.default_rng(5)
    time_s: Array = np.arange(400, dtype=np.float64) + 0.5
    for order, exchanged in (((0, 1, 2), False), ((1, 0, 2), True)):
        rate = (earth + 0.1 + rng.standard_normal((400, 3)))[:, list(order)]
        dataset = StaticDataset(directions, latitude, 1.0, 0.0, None, (Record(1, time_s, rate),))
        said = [flag.message for flag in analyse(dataset).flags if flag.code == CONTRADICTS]
        assert bool(said) is exchanged
        assert all("hold Y, X, Z in this order" in message for message in said)


def test_a_short_record_of_one_switch_on_gives_each_null_its_reason() -> None:
    found = analyse(records(np.random.default_rng(7), RLG, [30]))
    lost = [flag for flag in found.flags if flag.code == "not-identifiable"]
    missing = {estimate.name for estimate in found.estimates if estimate.value is None}
    assert {name for flag in lost for name in flag.details["coefficients"]} == missing
