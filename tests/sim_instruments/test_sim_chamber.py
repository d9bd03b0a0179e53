"""The simulated chamber: its air, what limits it, what breaks, and the gyros that follow."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fog_fixture import BENCH, fog_world

from sim_instruments.truth import Truth
from sim_instruments.world.chamber import Chamber

ROOM = 22.5
MINUTE = 60.0


def chamber(**changes: Any) -> Chamber:
    truth = BENCH["simulation"]["fog"]["chamber"] | changes
    return Chamber(Truth(truth, "chamber"))


STEADY = {"cycling": {"amplitude": "0 K", "period": "15 min"}}


def air(one: Chamber, *minutes: float) -> list[float]:
    return [float(value) for value in one.air_degC(MINUTE * np.array(minutes))]


def test_a_chamber_that_is_off_stays_at_room_temperature() -> None:
    one = chamber()
    one.set_point(0.0, -40.0)
    assert air(one, 0.0, 600.0) == [ROOM, ROOM]
    assert one.output(np.array([3600.0]))[0] == 0.0


def test_the_air_goes_as_fast_as_it_can_and_then_by_its_time_constant() -> None:
    one = chamber(**STEADY)
    one.set_point(0.0, 52.5)
    one.control(0.0, True)
    # 15 K of the 30 K at 3 K/min; within 15 K of its set-point it is slower than that.
    assert air(one, 2.0, 5.0) == pytest.approx([28.5, 37.5])
    assert air(one, 10.0, 20.0) == pytest.approx([52.5 - 15 * np.exp(-1), 52.5 - 15 * np.exp(-3)])
    one.set_point(1200.0, 22.5)
    assert air(one, 22.0)[0] == pytest.approx(air(one, 20.0)[0] - 4.0)
    high = np.array([60.0, 100.0, 1260.0, 1e5])
    assert one.output(high).tolist() == pytest.approx([1.0, 1.0, -1.0, 0.0], abs=0.1)
    one.set_point(9000.0, -300.0)
    assert air(one, 1000.0)[0] == pytest.approx(-75.0)


def test_the_air_cycles_about_its_set_point() -> None:
    one = chamber()
    one.control(100.0, True)
    times = 100.0 + np.arange(0.0, 36_000.0, 5.0)
    swing = one.air_degC(times) - ROOM
    assert np.abs(swing).max() == pytest.approx(0.15, rel=1e-3)
    rising = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    assert np.diff(times[rising]).mean() == pytest.approx(900.0, rel=1e-2)


@pytest.mark.parametrize("K_per_min", [0.2, 1.9, 3.0, 5.0, -1.0, -2.0, -6.0])
def test_a_ramp_of_the_set_point_is_the_limit_of_ever_smaller_steps(K_per_min: float) -> None:
    ramped, stepped = chamber(), chamber()
    rate, end = abs(K_per_min) / MINUTE, ROOM + np.copysign(20.0, K_per_min)
    for one in (ramped, stepped):
        one.control(0.0, True)
        one.set_point(0.0, ROOM - np.copysign(4.0, K_per_min))
    ramped.ramp(120.0, ROOM, end, rate)
    step_s = 20.0 / rate / 800
    for step in range(801):
        stepped.set_point(120.0 + step_s * step, ROOM + (end - ROOM) * (step + 0.5) / 800)
    stepped.set_point(120.0 + 800 * step_s, end)
    times = np.arange(0.0, 20.0 / rate + 3600.0, 7.0)
    np.testing.assert_allclose(ramped.air_degC(times), stepped.air_degC(times), atol=0.02)


def test_a_ramp_goes_on_after_an_interruption_and_ends_where_it_shall() -> None:
    one = chamber(**STEADY)
    one.control(0.0, True)
    one.ramp(0.0, ROOM, ROOM + 12.0, 0.2 / MINUTE)
    one.control(MINUTE * 30, False)
    one.control(MINUTE * 31, True)
    # It is followed one time constant late.
    assert air(one, 55.0)[0] == pytest.approx(ROOM + 10.0, abs=0.01)
    assert air(one, 200.0)[0] == pytest.approx(ROOM + 12.0)


def test_an_open_door_lets_the_room_in_and_a_chamber_that_is_off_drifts() -> None:
    one = chamber(**STEADY)
    one.set_point(0.0, -40.0)
    one.control(0.0, True)
    one.door(MINUTE * 300, True)
    assert air(one, 300.0, 308.0) == pytest.approx([-40.0, ROOM - 62.5 * np.exp(-1)])
    one.door(MINUTE * 310, False)
    assert air(one, 400.0)[0] == pytest.approx(-40.0, abs=0.01)
    one.control(MINUTE * 400, False)
    assert air(one, 580.0)[0] == pytest.approx(ROOM - 62.5 * np.exp(-1), abs=0.01)


def test_what_is_broken_cannot_hold_a_temperature() -> None:
    one = chamber(**STEADY)
    one.control(0.0, True)
    one.heater(0.0, False)
    one.set_point(0.0, 60.0)
    assert air(one, 600.0)[0] == ROOM and one.output(np.array([600.0]))[0] == 1.0
    one.set_point(6000.0, -20.0)
    assert air(one, 300.0)[0] == pytest.approx(-20.0)
    # Without its heater it comes up by the room's warmth, and stays where it shall.
    one.set_point(MINUTE * 300, 0.0)
    passed = 300.0 + 180.0 * np.log(42.5 / 22.5)
    assert air(one, passed - 1.0)[0] < 0.0
    assert air(one, passed, passed + 500.0) == pytest.approx([0.0, 0.0], abs=1e-9)
    one.compressor(MINUTE * 2000, False)
    assert air(one, 2180.0)[0] == pytest.approx(ROOM * (1 - np.exp(-1)))
    one.compressor(MINUTE * 2180, True)
    assert air(one, 2400.0)[0] == pytest.approx(0.0)


def test_a_gyro_follows_the_air_late_and_its_own_heat_makes_it_warmer() -> None:
    world = fog_world(powered_at_start=False)
    world.chamber.control(0.0, True)
    world.chamber.set_point(0.0, -40.0)
    world.power(18_000.0, True)
    cold = world.gyros.temperature_degC(np.array([18_000.0]))[0]
    assert np.all(cold > -40.0) and np.all(cold < -39.5)
    for axis, tau_min, rise in ((0, 42.0, 4.6), (1, 40.0, 5.2), (2, 44.0, 4.2)):
        later = 18_000.0 + MINUTE * np.array([tau_min, 100 * tau_min])
        warm = world.gyros.temperature_degC(later)[:, axis]
        assert warm[0] == pytest.approx(-40.0 + rise * (1 - np.exp(-1)), abs=0.2)
        assert warm[1] == pytest.approx(-40.0 + rise, abs=1e-6)
    begin_s = 300_000.0
    world.chamber.ramp(begin_s, -40.0, 60.0, 12.0 / 3600.0)
    end = np.array([begin_s + 18_000.0])
    behind = world.chamber.air_degC(end)[:, None] - world.gyros.temperature_degC(end)
    expected = 12.0 / 60 * np.array([42.0, 40.0, 44.0]) - [4.6, 5.2, 4.2]
    np.testing.assert_allclose(behind[0], expected, atol=0.05)
    world.power(float(end[0]), False)
    assert not world.dut_powered


def test_a_gyro_follows_exactly_as_its_equation_says() -> None:
    world = fog_world(chamber__cycling__amplitude="3 K", powered_at_start=False)
    one = world.chamber
    one.control(50.0, True)
    one.set_point(300.0, -20.0)
    world.power(900.0, True)
    one.set_point(2000.0, 50.0)
    one.door(3500.0, True)
    one.door(3700.0, False)
    world.power(5000.0, False)
    one.control(6000.0, False)
    edges = np.linspace(0.0, 8000.0, 80_001)
    middles = 0.5 * (edges[1:] + edges[:-1])
    on = (middles > 900.0) & (middles < 5000.0)
    felt = one.air_degC(middles)[:, None] + on[:, None] * np.array([4.6, 5.2, 4.2])
    tau_s = MINUTE * np.array([42.0, 40.0, 44.0])
    keep = np.exp(-0.1 / tau_s)
    state, course = np.full(3, ROOM), []
    for row in felt:
        state = row + (state - row) * keep
        course.append(state)
    found, rate = world.gyros.heat.temperature_and_rate(edges[1:])
    np.testing.assert_allclose(found, course, atol=1e-4)
    slope = np.diff(found, axis=0) / 0.1 - 0.5 * (rate[1:] + rate[:-1])
    # All but where it was switched on or off, or the air began to go elsewhere.
    assert np.sort(np.abs(slope).max(axis=1))[-20] < 1e-5
