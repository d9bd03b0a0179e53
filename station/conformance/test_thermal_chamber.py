"""What a thermal chamber owes: its limits, ramps that are even, and rest from any state."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError

pytestmark = pytest.mark.energises

RAMP_K = 2.0
RATE_K_PER_MIN = 0.5
LOOK_S = 10.0
AGREES_K = 0.1
NEAR_K = 2.0
STAYS_S = 60.0
BEYOND_ANY_RATING_DEGC = 5000.0
COOLS_WITHIN_S = 3600.0


def inward(fixture: Fixture, here_degC: float, by_K: float = RAMP_K) -> float:
    """Return a temperature that is `by_K` from another, on the side where the bench allows more."""
    middle = (fixture.limits["temperature_low"] + fixture.limits["temperature_high"]) / 2
    return here_degC + (by_K if here_degC < middle else -by_K)


def on(fixture: Fixture, chamber: Any) -> None:
    """Let the chamber hold the temperature it has."""
    chamber.programme_limits()
    chamber.switch_on()


def ramping(fixture: Fixture, chamber: Any) -> None:
    """Let the chamber be in the middle of a ramp."""
    on(fixture, chamber)
    chamber.ramp_to(inward(fixture, chamber.set_point_degC()), RATE_K_PER_MIN)
    fixture.clock.sleep(LOOK_S)
    assert chamber.is_ramping()


def holding(fixture: Fixture, chamber: Any) -> None:
    """Let the chamber hold where a ramp was ended."""
    ramping(fixture, chamber)
    chamber.hold()


def going(fixture: Fixture, chamber: Any) -> None:
    """Let the chamber go to a temperature as fast as it can."""
    on(fixture, chamber)
    chamber.set_temperature(inward(fixture, chamber.set_point_degC(), 10.0))
    fixture.clock.sleep(LOOK_S)


def refused(fixture: Fixture, chamber: Any) -> None:
    """Ask for a temperature that the bench forbids, on a ramp."""
    ramping(fixture, chamber)
    with pytest.raises(InstrumentError):
        chamber.set_temperature(fixture.limits["temperature_high"] + 1.0)


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, chamber: None,
    "limits-programmed": lambda fixture, chamber: chamber.programme_limits(),
    "on": on,
    "ramping": ramping,
    "holding": holding,
    "going": going,
    "a-request-refused": refused,
}


def test_the_limits_go_into_the_controller(fixture: Fixture, thermal_chamber: Any) -> None:
    """The controller's own limits hold when the program does not, and nothing is on by then."""
    thermal_chamber.identify()
    assert fixture.heard, "the driver passes nothing to the `trace` of its place"
    fixture.heard.clear()
    thermal_chamber.programme_limits()
    sent = [data for _, direction, data in fixture.heard if direction == ">"]
    assert sent, "programme_limits sends nothing"
    assert thermal_chamber.read_safety().safe


@pytest.mark.parametrize("limit", ["temperature_low", "temperature_high"])
def test_a_limit_beyond_the_rating_is_refused(
    fixture: Fixture, thermal_chamber: Any, limit: str
) -> None:
    """A bench file that allows more than the chamber can do is wrong."""
    thermal_chamber.close()  # some controllers take one client at a time
    sign = 1 if limit.endswith("high") else -1
    chamber = fixture.open(limits={**fixture.limits, limit: sign * BEYOND_ANY_RATING_DEGC})
    with pytest.raises(InstrumentError):
        chamber.programme_limits()


def test_a_temperature_beyond_the_limits_is_refused(fixture: Fixture, thermal_chamber: Any) -> None:
    """Gone to or ramped to: what the bench file forbids is not tried."""
    on(fixture, thermal_chamber)
    before_degC = thermal_chamber.set_point_degC()
    for beyond in (
        fixture.limits["temperature_low"] - 0.5,
        fixture.limits["temperature_high"] + 0.5,
        float("nan"),
    ):
        for verb, *rate in (
            (thermal_chamber.set_temperature,),
            (thermal_chamber.ramp_to, RATE_K_PER_MIN),
        ):
            with pytest.raises(InstrumentError) as raised:
                verb(beyond, *rate)
            assert raised.value.instrument == fixture.name
    assert not thermal_chamber.is_ramping()
    assert abs(thermal_chamber.set_point_degC() - before_degC) <= AGREES_K


@pytest.mark.parametrize("rate", [0.0, -RATE_K_PER_MIN, float("nan"), float("inf")])
def test_a_ramp_without_a_rate_is_refused(
    fixture: Fixture, thermal_chamber: Any, rate: float
) -> None:
    """A ramp that never ends, or takes no time, is none."""
    on(fixture, thermal_chamber)
    target_degC = inward(fixture, thermal_chamber.set_point_degC())
    with pytest.raises(InstrumentError):
        thermal_chamber.ramp_to(target_degC, rate)
    assert not thermal_chamber.is_ramping()


def test_nothing_is_gone_to_while_the_control_is_off(
    fixture: Fixture, thermal_chamber: Any
) -> None:
    """A set-point that nobody controls to would be waited for in vain."""
    thermal_chamber.programme_limits()
    target_degC = inward(fixture, thermal_chamber.temperature_degC())
    with pytest.raises(InstrumentError):
        thermal_chamber.set_temperature(target_degC)
    with pytest.raises(InstrumentError):
        thermal_chamber.ramp_to(target_degC, RATE_K_PER_MIN)


def test_it_is_switched_on_where_it_stands(fixture: Fixture, thermal_chamber: Any) -> None:
    """Switching on moves the temperature of the device nowhere."""
    thermal_chamber.programme_limits()
    air_degC = thermal_chamber.temperature_degC()
    thermal_chamber.switch_on()
    if fixture.limits["temperature_low"] <= air_degC <= fixture.limits["temperature_high"]:
        assert abs(thermal_chamber.set_point_degC() - air_degC) <= 1.0
    assert not thermal_chamber.is_ramping()
    assert not thermal_chamber.read_safety().safe


def test_a_ramp_is_even_and_ends_at_its_target(fixture: Fixture, thermal_chamber: Any) -> None:
    """Looked at now and then, the set-point is where its rate has brought it."""
    on(fixture, thermal_chamber)
    start_degC = thermal_chamber.set_point_degC()
    target_degC = inward(fixture, start_degC)
    began_s = fixture.clock.now()
    thermal_chamber.ramp_to(target_degC, RATE_K_PER_MIN)
    assert fixture.clock.now() - began_s <= 5.0, "ramp_to waits for the end of the ramp"
    seen = [(fixture.clock.now(), start_degC)]
    while thermal_chamber.is_ramping():
        assert fixture.clock.now() - began_s < 2 * 60 * RAMP_K / RATE_K_PER_MIN, "it never ends"
        fixture.clock.sleep(LOOK_S)
        seen.append((fixture.clock.now(), thermal_chamber.set_point_degC()))
    assert abs(thermal_chamber.set_point_degC() - target_degC) <= AGREES_K
    took_s = fixture.clock.now() - began_s
    assert abs(took_s - 60 * RAMP_K / RATE_K_PER_MIN) <= 2 * LOOK_S
    for (before_s, before_degC), (after_s, after_degC) in pairwise(seen):
        most_K = RATE_K_PER_MIN / 60 * (after_s - before_s) + 2 * AGREES_K
        assert abs(after_degC - before_degC) <= most_K, "the set-point jumps"


def test_the_air_follows_the_set_point(fixture: Fixture, thermal_chamber: Any) -> None:
    """What is set is what comes, in the time that a chamber takes."""
    on(fixture, thermal_chamber)
    target_degC = inward(fixture, thermal_chamber.set_point_degC(), 5.0)
    thermal_chamber.set_temperature(target_degC)
    until_s = fixture.clock.now() + COOLS_WITHIN_S
    while abs(thermal_chamber.temperature_degC() - target_degC) > NEAR_K:
        assert fixture.clock.now() < until_s, "the temperature does not come near its set-point"
        fixture.clock.sleep(LOOK_S)
    assert abs(thermal_chamber.set_point_degC() - target_degC) <= AGREES_K


def test_a_ramp_that_is_held_stays(fixture: Fixture, thermal_chamber: Any) -> None:
    """In the middle of a ramp, and twice."""
    ramping(fixture, thermal_chamber)
    for _ in range(2):
        thermal_chamber.hold()
        held_degC = thermal_chamber.set_point_degC()
        fixture.clock.sleep(STAYS_S)
        assert not thermal_chamber.is_ramping()
        assert abs(thermal_chamber.set_point_degC() - held_degC) <= AGREES_K


@pytest.mark.parametrize("state", STATES)
def test_it_is_off_from_any_state(fixture: Fixture, thermal_chamber: Any, state: str) -> None:
    """`make_safe` switches heater and compressor off before its deadline and can prove it."""
    STATES[state](fixture, thermal_chamber)
    deadline_s = fixture.clock.now() + fixture.within_s
    thermal_chamber.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s, "it came to rest after its deadline"
    reading = thermal_chamber.read_safety()
    assert reading.safe, reading.read_back
    fixture.clock.sleep(STAYS_S)
    thermal_chamber.temperature_degC()
    assert thermal_chamber.read_safety().safe, "a look switches it on again"


@pytest.mark.parametrize("state", ["on", "ramping"])
def test_a_chamber_that_controls_reads_back_as_unsafe(
    fixture: Fixture, thermal_chamber: Any, state: str
) -> None:
    """Nothing is assumed from what was commanded."""
    STATES[state](fixture, thermal_chamber)
    assert not thermal_chamber.read_safety().safe
