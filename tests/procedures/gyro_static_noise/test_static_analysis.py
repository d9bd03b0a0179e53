"""The noise of a gyro at rest recovered: bounds, coverage, and what mishaps do to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from static_records import DEVICES, bound_of_squares, measured_squares, records

from procedures.estimation.rate_spectrum import (
    coefficients,
    covariances,
    noise_variances,
    variances,
)
from procedures.gyro_static_noise.analysis import StaticAnalysis, analyse
from procedures.gyro_static_noise.dataset import Array, StaticDataset

FOG, RLG = DEVICES["FOG"], DEVICES["RLG"]
SAMPLES = 3600


def codes(analysis: StaticAnalysis) -> list[str]:
    return [one.code for one in analysis.flags]


def value(analysis: StaticAnalysis, name: str) -> float:
    found = analysis.estimate(name, "IA").value
    assert found is not None
    return found


def changed(dataset: StaticDataset, rate: Array, keep: Array | None = None) -> StaticDataset:
    """Return a dataset whose first record has these rates, or those of the kept places."""
    first, *rest = dataset.records
    places = np.ones(len(rate), dtype=bool) if keep is None else keep.astype(bool)
    fresh = replace(first, time_s=first.time_s[places], rate_deg_per_h=rate[places])
    return replace(dataset, records=(fresh, *rest))


@pytest.fixture(scope="module")
def fog() -> StaticDataset:
    return records(np.random.default_rng(3), FOG, [SAMPLES, 600, 600])


@pytest.fixture(scope="module")
def rlg() -> StaticDataset:
    return records(np.random.default_rng(5), RLG, [SAMPLES])


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


def test_a_ramp_is_no_random_walk(fog: StaticDataset) -> None:
    hours = fog.records[0].time_s[:, None] / 3600.0
    plain, ramped = analyse(fog), analyse(changed(fog, fog.records[0].rate_deg_per_h + hours))
    assert value(ramped, "rate_random_walk") == pytest.approx(
        value(plain, "rate_random_walk"), abs=1e-3
    )
    assert value(ramped, "rate_ramp") == pytest.approx(1.0 + value(plain, "rate_ramp"), abs=1e-3)
    assert "drift-removed" in codes(ramped)
    assert "drift-removed" not in codes(plain)


def test_a_line_is_named_and_spoils_nothing(fog: StaticDataset) -> None:
    time_s = fog.records[0].time_s[:, None]
    swing = 0.1 * np.sin(2.0 * np.pi * time_s / 300.0)
    plain, lined = analyse(fog), analyse(changed(fog, fog.records[0].rate_deg_per_h + swing))
    assert codes(plain).count("periodic") == 0
    (line,) = [one for one in lined.flags if one.code == "periodic"]
    assert line.details["period_s"] == pytest.approx(300.0, rel=0.01)
    assert line.details["amplitude_deg_per_h"] == pytest.approx(0.1, rel=0.2)
    assert value(lined, "bias_instability") == pytest.approx(
        value(plain, "bias_instability"), abs=0.005
    )


@pytest.mark.parametrize("data", ["fog", "rlg"])
def test_wild_samples_and_gaps_spoil_nothing(data: str, request: pytest.FixtureRequest) -> None:
    dataset: StaticDataset = request.getfixturevalue(data)
    rng = np.random.default_rng(8)
    rate = dataset.records[0].rate_deg_per_h.copy()
    rate[rng.integers(0, SAMPLES, 20)] += 40.0
    keep = np.ones(SAMPLES)
    keep[rng.integers(0, SAMPLES, 30)] = 0.0
    keep[1000:1040] = 0.0
    plain, spoilt = analyse(dataset), analyse(changed(dataset, rate, keep))
    assert {"outliers-rejected", "gap"} <= set(codes(spoilt))
    assert "outliers-rejected" not in codes(plain)
    for name in ("quantisation_noise", "angle_random_walk", "bias_instability"):
        one, other = plain.estimate(name, "IA"), value(spoilt, name)
        assert one.value is not None
        assert one.standard_uncertainty is not None
        assert abs(other - one.value) < 1.5 * one.standard_uncertainty, name


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


def test_frozen_and_saturated_stretches_are_left_out(fog: StaticDataset) -> None:
    rate = fog.records[0].rate_deg_per_h.copy()
    rate[500:550] = rate[500]
    rate[2000:2040] = 400.0
    found = analyse(changed(fog, rate))
    assert {"frozen", "saturated"} <= set(codes(found))
    assert value(found, "angle_random_walk") == pytest.approx(0.005, rel=0.05)
    assert value(found, "bias") == pytest.approx(value(analyse(fog), "bias"), abs=0.003)


def test_a_record_that_is_frozen_whole_gives_null(fog: StaticDataset) -> None:
    alone = replace(fog, records=fog.records[:1])
    found = analyse(changed(alone, np.full((SAMPLES, 1), 9.6)))
    assert all(one.value is None for one in found.estimates)
    assert "not-identifiable" in codes(found)


def test_rounding_that_follows_itself_is_computed() -> None:
    coarse = records(np.random.default_rng(2), DEVICES["RLG-coarse"], [SAMPLES])
    found = analyse(coarse)
    assert "coarse-output" in codes(found)
    assert value(found, "angle_random_walk") == pytest.approx(0.001, rel=0.15)
    assert value(found, "quantisation_noise") == pytest.approx(0.4 / np.sqrt(12.0), rel=0.06)


def test_a_rounded_rate_is_white(fog: StaticDataset) -> None:
    step = 3.0
    rate = np.round(fog.records[0].rate_deg_per_h / step) * step
    rate += step * (np.random.default_rng(0).random(rate.shape) < 0.5)  # moved by more than itself
    found = analyse(changed(replace(fog, records=fog.records[:1]), rate))
    assert "coarse-output" in codes(found)


def test_a_filtered_output_shows_no_quantisation(fog: StaticDataset) -> None:
    rate = fog.records[0].rate_deg_per_h[:, 0]
    filtered = np.convolve(rate, np.full(3, 1.0 / 3.0), mode="same")
    narrow = replace(fog, output_bandwidth_Hz=0.15, records=fog.records[:1])
    found = analyse(changed(narrow, filtered[:, None]))
    assert found.estimate("quantisation_noise", "IA").value is None
    assert value(found, "angle_random_walk") == pytest.approx(0.005, rel=0.12)
    assert "not-identifiable" in codes(found)


def test_white_noise_alone_is_a_short_record() -> None:
    quiet = {**FOG, "B": 0.0, "K": 0.0}
    found = analyse(records(np.random.default_rng(1), quiet, [SAMPLES]))
    (short,) = [one for one in found.flags if one.code == "short-record"]
    assert short.details["tau_s"] == pytest.approx(SAMPLES / 9.0)
    small = next(one for one in found.flags if one.code == "not-significant")
    assert "rate_random_walk" in small.details["coefficients"]


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
