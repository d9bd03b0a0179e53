"""The simulated navigator on its table: turns, attitude, noise, and its thrift."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fog_fixture import (
    AXES,
    BENCH,
    INNER,
    OUTER,
    TURN_S,
    aligned_world,
    attitude,
    delta_ppm,
    fog_world,
    point_up,
    turn,
    turned_deg,
)
from scipy.spatial.transform import Rotation

from sim_instruments.bench import SimulatedBench, world_of
from sim_instruments.truth import SimulationError
from sim_instruments.world.fog import FogBench
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
        assert abs(expected) > 10.0
        # Of the earth's rate, too, a gyro reads too much: less than a tenth of a ppm in all.
        assert 1e6 * error == pytest.approx(expected, abs=0.1)
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


def test_whoever_asks_when_and_in_which_order_gets_the_same() -> None:
    times = np.arange(300.0, 4000.0, 0.37)

    def worked(look: bool) -> FogBench:
        world = aligned_world(ideal=False)
        world.power(0.0, True)
        moments = [(1000.0, "x"), (1500.0, "y"), (2300.0, "z")]
        for start_s, axis in moments:
            if look:  # far ahead, as if nothing came
                world.navigator_attitude(np.array([start_s - 7.3, start_s + 900.0]))
                world.gyro_temperature_degC(np.array([start_s + 1e4]))
            chilled(world, start_s / 50.0, start_s)
            point_up(world, start_s, axis)
            turn(world, start_s + 60.0, 1)
            world.table.axis(INNER).stop(start_s + 3.21, 10.0)
            if look:
                world.navigator_attitude(start_s + np.arange(0.0, 70.0, 3.3))
        return world

    at_once, bit_by_bit = worked(False), worked(True)
    whole = at_once.navigator_attitude(times)
    parts = [bit_by_bit.navigator_attitude(some) for some in np.array_split(times, 97)[::-1]]
    np.testing.assert_allclose(np.concatenate(parts[::-1]), whole, rtol=0, atol=1e-7)
    sensed = [bit_by_bit.gyro_temperature_degC(some) for some in np.array_split(times, 13)]
    np.testing.assert_allclose(
        np.concatenate(sensed), at_once.gyro_temperature_degC(times), rtol=0, atol=1e-9
    )
    assert at_once.version != fog_world().version


def test_noise_is_as_large_as_the_truth_says() -> None:
    world = aligned_world(gyros__angle_random_walk="0.002 deg/sqrt(h)")
    heading = world.navigator_attitude(np.arange(1000.0, 200_000.0, 100.0))[:, 0]
    steps = (np.diff(heading) + 180.0) % 360.0 - 180.0
    assert np.std(steps) == pytest.approx(0.002 * np.sqrt(100.0 / 3600.0), rel=0.1)
    walks = aligned_world(gyros__bias_walk="0.05 deg/h/sqrt(h)")
    hours = np.arange(1.0, 400.0) * 3600.0
    rates = walks.gyros.bias_rad_per_s(hours, np.zeros((399, 3)), np.zeros((399, 3)))
    per_hour = np.degrees(np.diff(rates, axis=0)) * 3600.0
    assert np.std(per_hour) == pytest.approx(0.05, rel=0.1)
    put_out = aligned_world(navigator__heading_noise="0.01 deg", navigator__level_noise="0.02 deg")
    angles = (put_out.navigator_attitude(np.arange(1000.0, 2000.0)) + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(angles.std(axis=0), [0.01, 0.02, 0.02], rtol=0.1)
    sensed = aligned_world(gyros__sensor_noise="0.02 K").gyro_temperature_degC
    assert np.std(sensed(np.arange(1000.0, 2000.0))[:, 0]) == pytest.approx(0.02, rel=0.1)


def test_ripple_and_hysteresis_add_to_the_curve() -> None:
    plain = fog_world()
    world = fog_world(
        gyros__x__ripple={"amplitude": "8 ppm", "period": "25 K"},
        gyros__x__hysteresis={"half_width": "5 ppm", "rate": "2 degC/h"},
    )
    at = np.tile(np.array([[6.25], [12.5]]), 3)
    added = [
        1e6 * (world.gyros.scale_factor_error(at, rate) - plain.gyros.scale_factor_error(at))
        for rate in (0.0, 12.0 / 3600, -12.0 / 3600)
    ]
    np.testing.assert_allclose(added[0][:, 0], [8.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(added[1][:, 0], [13.0, 5.0], atol=1e-3)
    np.testing.assert_allclose(added[2][:, 0], [3.0, -5.0], atol=1e-3)
    assert not np.array(added)[:, :, 1:].any()


def test_a_day_at_rest_costs_little_and_a_turn_some_thirty_panels() -> None:
    world = aligned_world(ideal=False)
    trajectory = world._navigator._trajectory(world._navigator._alignments[0])
    day_s = 86_400.0
    world.navigator_attitude(np.array([day_s]))
    resting = trajectory._nodes.count
    assert resting <= day_s / 15.0
    turn(world, day_s, 1)
    world.navigator_attitude(np.array([day_s + 37.0]))
    assert trajectory._nodes.count - resting < 45


def test_acts_mount_connect_and_switch() -> None:
    world = fog_world(powered_at_start=False)
    assert not world.dut_powered
    for prompt in world.preparations:
        world.act(prompt, 5.0)
    assert world.dut_powered
    world.act("dut-power-off", 6.0)
    assert not world.dut_powered
    with pytest.raises(SimulationError, match="dut-power-on"):
        world.act("heat-cell", 7.0)


def test_a_truth_that_cannot_be_is_refused() -> None:
    for path, value, words in (
        ("table__outer__axis", 2, "1, 2 and 3"),
        ("table__inner__along", "w", "x, y or z"),
        ("gyros__x__lag", "5 min", "one of the chamber's own"),
        ("gyros__x__scale_factor_error", {}, "u0"),
        ("gyros__temperature_range", {"low": "60 degC", "high": "-40 degC"}, "below"),
        ("navigator__levelling", "0 s", "positive"),
        ("chamber__heating", "0 degC/min", "positive"),
    ):
        with pytest.raises(SimulationError, match=words):
            fog_world(**{path: value})
    with pytest.raises(SimulationError, match="not 4"):
        fog_world().table.axis(4)


def test_the_whole_bench_serves_in_this_world() -> None:
    assert world_of(PROCEDURE) is FogBench
    clock = VirtualClock()
    bench = SimulatedBench(BENCH, clock, PROCEDURE)
    try:
        bench.make_ready()
        report: dict[str, Any] = bench.simulation_report()
        assert report["dut_powered"] and "coil_supply.dc" in bench.instruments
    finally:
        bench.close()
        clock.stop()


def test_the_axes_of_a_table_lean_as_the_truth_says() -> None:
    world = fog_world(table__outer__lean={"towards_x": "1 deg", "towards_y": "0 deg"})
    table: Table = world.table
    table.axis(OUTER).turn_at(0.0, 5.0, 1e6)
    rate = table.motion(np.array([10.0])).rate_rad_per_s[0]
    leaning = np.array([np.sin(np.radians(1.0)), 0.0, np.cos(np.radians(1.0))])
    np.testing.assert_allclose(np.degrees(rate), 5.0 * leaning, rtol=1e-12)
    wandering = fog_world(table__wander="1 arcsec").table
    times = np.arange(0.0, 50_000.0, 47.0)
    angles = Rotation.from_matrix(wandering.attitude(times)).as_rotvec() * 3600 * 180 / np.pi
    np.testing.assert_allclose(angles.std(axis=0), 1.0, rtol=0.1)
