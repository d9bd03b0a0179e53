"""The noise of a gyro at rest recovered: bounds, coverage, long gaps, repeatability."""

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
