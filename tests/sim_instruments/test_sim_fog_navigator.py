"""How the simulated navigator aligns, integrates its rates and holds the vertical."""

from __future__ import annotations

import numpy as np
import pytest
from fog_fixture import (
    AXES,
    BENCH,
    EARTH_DEG_PER_S,
    INNER,
    LATITUDE_DEG,
    MIDDLE,
    OUTER,
    aligned_world,
    attitude,
    fog_world,
    turned_deg,
)
from scipy.spatial.transform import Rotation


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
    world.chamber.set_point(0.0, 60.0)
    world.chamber.control(0.0, True)
    for axis, rate in ((OUTER, 14.0), (MIDDLE, -9.0), (INNER, 11.0)):
        table.axis(axis).turn_at(400.0 + axis, rate, 3.0)
        table.axis(axis).stop(430.0 + axis, 5.0)
    begin_s, end_s, steps = 400.0, 450.0, 20_000
    found = attitude(world, begin_s)
    step_s = (end_s - begin_s) / steps
    ends = begin_s + np.arange(1, steps + 1) * step_s
    latitude = np.radians(LATITUDE_DEG)
    earth = np.radians(EARTH_DEG_PER_S) * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    mounting = BENCH["simulation"]["fog"]["navigator"]["mounting_error"]
    small = [float(mounting[f"about_{axis}"].split()[0]) for axis in AXES]
    plate = Rotation.from_rotvec(small, degrees=True).as_matrix()
    middle = table.motion(ends - 0.5 * step_s)
    rates = np.einsum("nji,nj->ni", middle.attitude @ plate, middle.rate_rad_per_s + earth)
    measured = rates + world.gyros.errors_rad_per_s(ends - 0.5 * step_s, rates)
    turns = Rotation.from_rotvec(measured * step_s).as_matrix()
    true = table.motion(ends).attitude @ plate
    without_earth = Rotation.from_rotvec(-earth * step_s).as_matrix()
    for step, after in zip(turns, true, strict=True):
        found = without_earth @ found @ step
        # What it takes for the vertical, turned back to the vertical that it feels.
        north, east, _ = (found @ after.T)[:, 2] * step_s / 120.0
        found = (
            found + np.array([[0.0, 0.0, -north], [0.0, 0.0, -east], [north, east, 0.0]]) @ found
        )
    difference = Rotation.from_matrix(attitude(world, end_s) @ found.T).magnitude()
    assert np.degrees(difference) < 2e-5


def test_alignment_takes_its_time_and_begins_again_when_the_table_turns() -> None:
    world = fog_world(powered_at_start=False)
    world.align(0.0, LATITUDE_DEG)
    world.power(10.0, True)
    assert not world.aligned(1000.0), "what is off hears nothing"
    world.align(1000.0, LATITUDE_DEG)
    assert not world.aligned(1299.9) and world.aligned(1300.0)
    world.table.axis(OUTER).move_to(1200.0, 10.0, 10.0, 10.0)
    assert not world.aligned(1300.0)
    assert world.aligned(1502.0) and not world.aligned(1501.9)
    assert not world.navigator_attitude(np.array([1400.0])).any()
    assert world.navigator_attitude(np.array([1502.0]))[0, 0] == pytest.approx(10.0, abs=1e-3)
    world.table.axis(OUTER).move_to(1600.0, 0.0, 10.0, 10.0)
    assert world.aligned(1601.0), "an aligned one may be turned"
    world.power(1700.0, False)
    assert world.aligned(1699.0) and not world.aligned(1700.0) and not world.dut_powered
    world.table.axis(OUTER).turn_at(1800.0, 1.0, 1.0)
    world.power(1800.0, True)
    world.align(1800.0, LATITUDE_DEG)
    assert not world.aligned(1e5), "a table that turns for ever lets nobody align"


def test_a_wrong_latitude_leaves_a_part_of_the_earth_rate() -> None:
    world = fog_world()
    world.align(0.0, LATITUDE_DEG + 1.0)
    drifted = turned_deg(world, 1000.0, 4600.0)
    wrong = np.sin(np.radians(LATITUDE_DEG + 1.0)) - np.sin(np.radians(LATITUDE_DEG))
    assert drifted == pytest.approx(15.041067 * wrong, rel=2e-2)
    right = aligned_world()
    assert abs(turned_deg(right, 1000.0, 4600.0)) < 1e-3


def test_the_vertical_is_held_and_the_heading_is_not() -> None:
    world = aligned_world(
        gyros__x__bias="1 deg/h",
        navigator__alignment__heading_error="0.1 deg",
        navigator__alignment__level_error="0.05 deg",
    )
    first, pitch, _ = world.navigator_attitude(np.array([300.0, 3000.0])).T
    heading = (first + 180.0) % 360.0 - 180.0
    assert abs(heading[0]) > 1e-3 and heading[1] == pytest.approx(heading[0], abs=5e-3)
    roll = world.navigator_attitude(np.array([3000.0]))[0, 2]
    assert abs(pitch[0]) > 1e-3 and abs(pitch[1]) < 2e-3
    assert roll == pytest.approx(1.0 / 3600 * 120, rel=0.1)
