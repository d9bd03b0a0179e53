"""The simulated navigator on its table: turns, attitude, alignment, noise, and its thrift."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fog_stand import (
    ACCELERATION,
    AXES,
    BENCH,
    EARTH_DEG_PER_S,
    INNER,
    LATITUDE_DEG,
    MIDDLE,
    OUTER,
    TURN_S,
    Array,
    aligned_world,
    attitude,
    delta_ppm,
    fog_world,
    point_up,
    turn,
    turned_deg,
)
from scipy.spatial.transform import Rotation

from sim_instruments.bench import WORLDS, SimulatedBench
from sim_instruments.truth import SimulationError
from sim_instruments.world.fog_bench import FogBench
from sim_instruments.world.table import Table
from station.clock import VirtualClock

PROCEDURE = "fog-scale-factor-temperature"


def chilled(world: FogBench, degC: float, time_s: float = 0.0) -> None:
    world.chamber.set_point(time_s, degC)
    world.chamber.control(time_s, True)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("sense", [1, -1])
def test_a_turn_about_an_axis_that_is_up_reads_its_scale_factor_error_too_much(
    axis: str, sense: int
) -> None:
    world = aligned_world()
    chilled(world, -30.0)
    for start_s in (20_000.0, 30_000.0):
        point_up(world, start_s, axis)
        turn(world, start_s + 60.0, sense)
        error = turned_deg(world, start_s + 55.0, start_s + 65.0 + TURN_S) / (sense * 360.0)
        expected = delta_ppm(world, axis, start_s + 60.0 + TURN_S / 2)
        assert abs(expected) > 30.0
        assert 1e6 * error == pytest.approx(expected, abs=0.02)
        chilled(world, 45.0, 20_100.0)


def test_with_all_its_flaws_a_pair_of_turns_still_reads_that_error_within_its_noise() -> None:
    world = aligned_world(ideal=False)
    chilled(world, -20.0)
    errors = []
    for k in range(60):
        axis, start_s = AXES[k % 3], 20_000.0 + 200.0 * k
        point_up(world, start_s, axis)
        turn(world, start_s + 60.0, 1)
        turn(world, start_s + 109.0, -1)
        ends = start_s + np.array([55.0, 102.0, 104.0, 151.0])
        there, back = turned_deg(world, *ends[:2]), turned_deg(world, *ends[2:])
        errors.append(1e6 * (there - back) / 720.0 - delta_ppm(world, axis, start_s + 103.0))
    # A random walk of 0.002 deg/sqrt(h) and a table that is 0.4 arcsec wrong, in two turns.
    sigma = np.hypot(0.63, 0.4 * np.sqrt(2) / 1.296) / np.sqrt(2)
    assert np.std(errors) == pytest.approx(sigma, rel=0.4)
    assert abs(np.mean(errors)) < 4 * sigma / np.sqrt(60)


def test_a_bias_adds_to_every_turn_and_a_pair_takes_it_out() -> None:
    world = aligned_world(gyros__z__bias="-1 deg/h")  # z is up: the heading reads +1 deg/h
    point_up(world, 1000.0, "z")
    turn(world, 1100.0, 1)
    turn(world, 1150.0, -1)
    there, back = turned_deg(world, 1095.0, 1142.0), turned_deg(world, 1145.0, 1192.0)
    delta = delta_ppm(world, "z", 1150.0)
    assert 1e6 * there / 360 - delta == pytest.approx(1e6 * 47 / 3600 / 360, rel=1e-3)
    assert 1e6 * (there - back) / 720 == pytest.approx(delta, abs=0.02)
    assert (there + back) / 2 / 47 * 3600 == pytest.approx(1.0, rel=1e-3)


def test_a_coil_that_warms_up_reads_a_rate() -> None:
    world = aligned_world(gyros__shupe_at_1_degC_per_min="0.5 deg/h")
    chilled(world, 60.0)
    rate = world.gyros.heat.temperature_and_rate(np.array([2000.0]))[1][0, 2] * 60.0
    assert rate > 0.1
    drifted = turned_deg(world, 1990.0, 2010.0) / 20.0 * 3600.0
    assert drifted == pytest.approx(0.5 * rate, rel=1e-2)


def test_the_attitude_is_that_of_the_axis_which_is_up() -> None:
    world = aligned_world()
    for number, (axis, expected) in enumerate(
        {"x": (None, 90.0, None), "y": (30.0, 0.0, -90.0), "z": (30.0, 0.0, 180.0)}.items()
    ):
        start_s = 1000.0 + 100.0 * number
        world.table.axis(OUTER).move_to(start_s, 30.0, 10.0, 10.0)
        point_up(world, start_s, axis)
        angles = world.navigator_attitude(np.array([start_s + 60.0]))[0]
        for found, wanted in zip(angles, expected, strict=True):
            if wanted is not None:
                assert abs((found - wanted + 180.0) % 360.0 - 180.0) < 0.1
        up = attitude(world, start_s + 60.0)[:, AXES.index(axis)]
        assert up[2] < -0.999999


def test_a_heading_stays_within_a_turn_and_grows_clockwise() -> None:
    world = aligned_world()
    turn(world, 1000.0, 1)
    times = np.linspace(1000.0, 1040.0, 4001)
    heading = world.navigator_attitude(times)[:, 0]
    assert heading.min() >= 0.0 and heading.max() < 360.0
    steps = (np.diff(heading) + 180.0) % 360.0 - 180.0
    # At rest there is still the levelling, which turns nothing about the vertical.
    assert steps.min() > -1e-6 and steps.sum() == pytest.approx(360.0, abs=0.5)


def test_the_navigator_integrates_its_rates_as_small_steps_do() -> None:
    world = aligned_world(
        ideal=False,
        table__wander="0 deg",
        gyros__angle_random_walk="0 deg/sqrt(h)",
        gyros__bias_walk="0 deg/h/sqrt(h)",
        navigator__heading_noise="0 deg",
        navigator__level_noise="0 deg",
    )
    table = world.table
    chilled(world, 60.0)
    for axis, rate in ((OUTER, 14.0), (MIDDLE, -9.0), (INNER, 11.0)):
        table.axis(axis).turn_at(400.0 + axis, rate, 3.0)
        table.axis(axis).stop(430.0 + axis, 5.0)
    begin_s, end_s, steps = 400.0, 450.0, 10_000
    found = attitude(world, begin_s)
    middles = begin_s + (np.arange(steps) + 0.5) * (end_s - begin_s) / steps
    step_s = (end_s - begin_s) / steps
    latitude = np.radians(LATITUDE_DEG)
    earth = np.radians(EARTH_DEG_PER_S) * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    mounting = BENCH["simulation"]["fog"]["navigator"]["mounting_error"]
    small = [float(str(mounting[f"about_{axis}"]).split()[0]) for axis in AXES]
    body = table.motion(middles).attitude @ Rotation.from_rotvec(small, degrees=True).as_matrix()
    rates = np.einsum("nji,nj->ni", body, table.motion(middles).rate_rad_per_s + earth)
    measured = rates + world.gyros.errors_rad_per_s(middles, rates)
    turns = Rotation.from_rotvec(measured * step_s).as_matrix()
    back = Rotation.from_rotvec(-earth * step_s).as_matrix()
    for each in turns:
        found = back @ found @ each
        down = attitude_down(found, body, len(middles), each)
        found = Rotation.from_rotvec(down * step_s / 120.0).as_matrix() @ found
    difference = Rotation.from_matrix(attitude(world, end_s) @ found.T).magnitude()
    assert np.degrees(difference) < 2e-5


def attitude_down(found: Array, body: Array, count: int, each: Array) -> Array:
    raise NotImplementedError
