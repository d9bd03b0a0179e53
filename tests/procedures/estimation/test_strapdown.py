"""Strapdown navigation against an analytic trajectory and Schuler's period."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_journey import Journey, normal_gravity, simulated_journey

from procedures.estimation.strapdown import (
    EARTH_RATE_RAD_PER_S,
    State,
    Track,
    blocks_of,
    gravity_m_per_s2,
    navigate,
    radii_m,
    rotation,
)

ALONE = np.zeros(1, dtype=np.int64)


def at_rest(tilt_rad: float, hours: float, latitude_rad: float) -> tuple[np.ndarray, Track]:
    time_s = np.arange(0.0, hours * 3600.0 + 1.0, 2.0)
    earth = EARTH_RATE_RAD_PER_S * np.array([np.cos(latitude_rad), 0.0, -np.sin(latitude_rad)])
    up = np.array([0.0, 0.0, -float(gravity_m_per_s2(latitude_rad, 0.0))])
    rows = len(time_s)
    blocks = blocks_of(time_s, np.tile(earth, (1, rows, 1)), np.tile(up, (rows, 1)), 1)
    attitude = rotation(np.array([[0.0, tilt_rad, 0.0]]))
    start = State(np.array([latitude_rad]), np.zeros(1), np.zeros((1, 2)), attitude)
    still = np.zeros(len(blocks.time_s))
    return blocks.time_s, navigate(blocks, start, still, still, ALONE)


def track_of(journey: Journey, per_block: int) -> tuple[np.ndarray, np.ndarray]:
    rates = np.radians(journey.rate_deg_per_s)[None]
    blocks = blocks_of(journey.time_s, rates, journey.force_m_per_s2, per_block)
    attitude = Rotation.from_euler("ZYX", journey.attitude_deg[:1], degrees=True).as_matrix()
    start = State(
        np.radians(journey.latitude_deg[:1]),
        np.radians(journey.longitude_deg[:1]),
        journey.velocity_m_per_s[:1, :2],
        attitude,
    )
    rows = np.searchsorted(journey.time_s, blocks.time_s)
    down = journey.velocity_m_per_s[rows, 2]
    track = navigate(blocks, start, journey.height_m[rows], down, ALONE)
    along, across = radii_m(np.radians(journey.latitude_deg[rows]))
    north = (track.latitude_rad[:, 0] - np.radians(journey.latitude_deg[rows])) * along
    east = (track.longitude_rad[:, 0] - np.radians(journey.longitude_deg[rows])) * across
    off = np.column_stack((north, east * np.cos(track.latitude_rad[:, 0])))
    return off, track.velocity_m_per_s[:, 0] - journey.velocity_m_per_s[rows, :2]


def test_a_tilt_swings_with_schulers_period() -> None:
    time_s, track = at_rest(1e-5, 1.5, np.radians(40.0))
    velocity = track.velocity_m_per_s[:, 0, 0]
    crossings = time_s[1:][np.diff(np.sign(velocity)) != 0.0]
    assert (crossings[-1] - 0.0) / 60.0 == pytest.approx(84.4, abs=0.2)
    along, _ = radii_m(np.radians(40.0))
    swing = np.ptp(track.latitude_rad[:, 0]) * along
    assert swing == pytest.approx(2.0 * 1e-5 * along, rel=0.01)


def test_what_is_level_and_at_rest_stays_where_it_is() -> None:
    _, track = at_rest(0.0, 1.5, np.radians(-33.0))
    assert np.ptp(track.latitude_rad[:, 0]) * 6.4e6 < 0.05
    assert np.ptp(track.longitude_rad[:, 0]) * 6.4e6 < 0.05


@pytest.mark.parametrize("per_block", [1, 20])
def test_an_analytic_trajectory_is_followed(per_block: int) -> None:
    off_m, off_m_per_s = track_of(simulated_journey(interval_s=0.05, climb_m=60.0), per_block)
    assert np.abs(off_m).max() < 0.02
    assert np.abs(off_m_per_s).max() < 1e-4


def test_gravity_is_that_of_the_ellipsoid() -> None:
    for latitude in (0.0, 0.7, -1.2):
        own = normal_gravity(np.array([latitude]), 300.0)
        assert gravity_m_per_s2(latitude, 300.0) == pytest.approx(own[0], abs=2e-6)
