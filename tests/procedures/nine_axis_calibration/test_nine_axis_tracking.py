"""The table's angle between readings: a line through them all, or from one to the next."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.estimation.turn_track import track


def readings(
    rate: float, span_s: float, count: int, jitter_s: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and angles of a table that keeps its rate, its encoder with a sine of 1 arcsec.

    Each reading is later than its time says by a random part of `jitter_s`.
    """
    generator = np.random.default_rng(seed)
    time_s = np.linspace(10.0, 10.0 + span_s, count)
    true_deg = 77.0 + rate * (time_s + jitter_s * generator.standard_normal(count) - 10.0)
    return time_s, true_deg + np.sin(np.radians(true_deg)) / 3600.0


@pytest.mark.parametrize("jitter_s", [0.0, 1e-3])
def test_the_rate_of_one_fast_turn_is_as_uncertain_as_said(jitter_s: float) -> None:
    off = []
    for seed in range(200):
        found = track(*readings(100.0, 3.7, 50, jitter_s, seed))
        u = np.sqrt(2.0) * found.end_u_deg / 3.7
        error = found.rate_deg_per_s - 100.0
        if jitter_s == 0.0:
            # The graduation's sine is taken off: a line alone would be 1 ppm wrong.
            assert abs(error) < 1e-7 * 100.0
            return
        off.append(error / u)
    assert 0.85 < np.std(off) < 1.15


def test_a_millisecond_of_jitter_costs_a_tenth_of_what_two_readings_would() -> None:
    found = track(*readings(100.0, 10.0, 100, 1e-3, 1))
    assert found.end_u_deg * np.sqrt(2.0) < 0.4 * 0.1 * np.sqrt(2.0)


@pytest.mark.parametrize(("span_s", "count"), [(3.7, 50), (2.0, 30), (2.0, 5)])
def test_readings_that_took_long_count_less_and_the_rate_is_as_sure_as_said(
    span_s: float, count: int
) -> None:
    off, plain_off, said = [], [], []
    for seed in range(300):
        generator = np.random.default_rng(seed)
        took_s = 1e-3 * np.exp(generator.normal(0.0, 1.0, count))
        time_s, angle_deg = readings(100.0, span_s, count, 0.0, seed)
        angle_deg = angle_deg + 100.0 * took_s * generator.uniform(-0.5, 0.5, count)
        found, plain = track(time_s, angle_deg, took_s), track(time_s, angle_deg)
        off.append(abs(found.rate_deg_per_s - 100.0))
        plain_off.append(abs(plain.rate_deg_per_s - 100.0))
        said.append(np.sqrt(2.0) * found.end_u_deg / span_s)
    assert 0.8 < np.quantile(np.array(off) / said, 0.683) < 1.25
    assert np.median(off) < (0.7 if count > 10 else 1.01) * np.median(plain_off)


def test_a_table_that_wanders_is_followed_from_reading_to_reading() -> None:
    time_s, angle_deg = readings(1.0, 360.0, 400, 0.0, 3)
    wander_deg = 0.003 * np.sin(2.0 * np.pi * time_s / 97.0)
    found = track(time_s, angle_deg + wander_deg)
    middle_s = 0.5 * (time_s[1:] + time_s[:-1])
    assert found.readings is not None
    expected = 77.0 + (middle_s - 10.0) + 0.003 * np.sin(2.0 * np.pi * middle_s / 97.0)
    assert np.abs(found.angle_deg(middle_s) - expected).max() < 0.0005


def test_few_readings_give_the_rate_of_the_first_and_the_last() -> None:
    found = track(np.array([0.0, 1.0, 2.0]), np.array([5.0, 15.1, 25.0]))
    assert found.rate_deg_per_s == pytest.approx(10.0)
    assert found.angle_deg(np.array([1.0]))[0] == pytest.approx(15.1)


@pytest.mark.parametrize("wander_deg", [0.0, 0.5])
def test_where_the_last_readings_are_lost_only_a_table_that_keeps_its_rate_is_known(
    wander_deg: float,
) -> None:
    time_s, angle_deg = readings(100.0, 5.0, 50, 1e-4, 4)
    angle_deg = angle_deg + wander_deg * np.sin(time_s)
    found = track(time_s[3:-7], angle_deg[3:-7])
    steady = wander_deg == 0.0
    assert found.known(10.0, 15.0) == ((10.0, 15.0) if steady else (time_s[3], time_s[-8]))
    at_s = np.linspace(*found.known(10.0, 15.0), 9)
    expected = np.interp(at_s, time_s, angle_deg)
    assert np.abs(found.angle_deg(at_s) - expected).max() < 0.05
