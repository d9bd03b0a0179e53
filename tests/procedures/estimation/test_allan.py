"""Allan deviation: against its definition, in white noise, across gaps, and what it is made of."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.estimation.allan import allan_deviation, noise_coefficients

WALK_deg_per_sqrt_h = 0.01
INTERVAL_s = 1.0


def white(seed: int, samples: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return 60.0 * WALK_deg_per_sqrt_h * generator.standard_normal(samples)


def test_it_is_what_the_definition_says() -> None:
    rate = white(0, 60)
    allan = allan_deviation(rate, INTERVAL_s)
    for tau_s, deviation in zip(allan.tau_s, allan.deviation, strict=True):
        m = round(tau_s)
        means = [rate[k : k + m].mean() for k in range(len(rate) - m + 1)]
        steps = [means[k + m] - means[k] for k in range(len(means) - m)]
        assert deviation == pytest.approx(np.sqrt(np.mean(np.square(steps)) / 2))


def test_white_noise_falls_with_the_root_of_time() -> None:
    allan = allan_deviation(white(1, 20000), INTERVAL_s)
    expected = 60.0 * WALK_deg_per_sqrt_h / np.sqrt(allan.tau_s)
    off = (allan.deviation - expected) / (expected * allan.standard_uncertainty / allan.deviation)
    assert np.abs(off).max() < 4.0


def test_a_cluster_with_a_missing_sample_does_not_count() -> None:
    rate = white(2, 3000)
    there = np.random.default_rng(3).random(3000) > 0.02
    whole = allan_deviation(rate, INTERVAL_s)
    gaps = allan_deviation(rate[there], INTERVAL_s, np.flatnonzero(there))
    assert gaps.deviation[0] == pytest.approx(whole.deviation[0], rel=0.05)
    assert gaps.tau_s[-1] < whole.tau_s[-1]


def test_the_coefficients_of_a_made_record_come_back() -> None:
    generator = np.random.default_rng(4)
    walk = 0.05  # deg/h/sqrt(h)
    steps = walk / 60.0 * generator.standard_normal(40000)
    allan = allan_deviation(white(5, 40000) + np.cumsum(steps), INTERVAL_s)
    found = noise_coefficients(allan)
    assert found is not None
    assert found.angle_random_walk_deg_per_sqrt_h == pytest.approx(WALK_deg_per_sqrt_h, rel=0.03)
    total = allan_deviation(np.cumsum(steps), INTERVAL_s)
    assert noise_coefficients(total) is not None
    assert found.rate_random_walk_deg_per_h_sqrt_h < 3 * walk


def test_flicker_is_seen_where_it_is_and_seldom_in_white_noise() -> None:
    slow = np.repeat(0.3 * np.random.default_rng(7).standard_normal(12), 300)
    records = [white(seed, 3600) for seed in range(40)]
    for wander, least, most in ((0.0, 0, 6), (slow, 30, 40)):
        found = [noise_coefficients(allan_deviation(one + wander, INTERVAL_s)) for one in records]
        assert least <= sum(one is not None and one.bias_instability_seen for one in found) <= most


def test_too_short_a_record_has_none() -> None:
    assert len(allan_deviation(np.zeros(4), INTERVAL_s).tau_s) == 0
    assert noise_coefficients(allan_deviation(np.zeros(4), INTERVAL_s)) is None


def test_counted_pulses_show_as_quantisation() -> None:
    pulse_arcsec, interval_s = 0.6, 0.1
    generator = np.random.default_rng(6)
    angle = np.cumsum(9.3 + generator.standard_normal(20000)) * interval_s
    counted = np.diff(np.floor(angle / pulse_arcsec)) * pulse_arcsec / interval_s
    found = noise_coefficients(allan_deviation(counted, interval_s))
    assert found is not None
    assert found.quantisation_arcsec == pytest.approx(pulse_arcsec / np.sqrt(12.0), rel=0.15)
    tau_s = np.array([0.1, 1.0])
    one, other = found.deviation_deg_per_h(tau_s)
    assert one > 5 * other
