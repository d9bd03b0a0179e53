"""What a cell's heater owes: its limit, a ramp that ends at its target, and rest from any state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError

pytestmark = pytest.mark.energises

RAMP_K = 5.0
MOST_K_PER_MIN = 5.0
LOOK_S = 5.0
AGREES_K = 0.1
NEAR_K = 1.0
STAYS_S = 60.0
WARMS_WITHIN_S = 1800.0
BEYOND_ANY_RATING_DEGC = 5000.0


def rate(fixture: Fixture) -> float:
    """Return a rate that the bench allows, in degC/min."""
    return min(fixture.limits["temperature_slew"], MOST_K_PER_MIN)


def on(fixture: Fixture, heater: Any) -> None:
    """Let the heater hold the temperature that the cell has."""
    heater.programme_limits()
    heater.switch_on()


def ramping(fixture: Fixture, heater: Any) -> None:
    """Let the heater be in the middle of a ramp."""
    on(fixture, heater)
    heater.ramp_to(heater.set_point_degC() + RAMP_K, rate(fixture))
    fixture.clock.sleep(LOOK_S)
    assert heater.is_ramping()


def refused(fixture: Fixture, heater: Any) -> None:
    """Ask for a temperature that the bench forbids, on a ramp."""
    ramping(fixture, heater)
    with pytest.raises(InstrumentError):
        heater.ramp_to(fixture.limits["temperature_high"] + 1.0, rate(fixture))


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, heater: None,
    "limits-programmed": lambda fixture, heater: heater.programme_limits(),
    "on": on,
    "ramping": ramping,
    "a-request-refused": refused,
}


def test_the_limit_goes_into_the_controller(fixture: Fixture, cell_heater: Any) -> None:
    """The controller's own limit holds when the program does not, and nothing is on by then."""
    cell_heater.identify()
    fixture.heard.clear()
    cell_heater.programme_limits()
    assert [data for _, direction, data in fixture.heard if direction == ">"], "it sends nothing"
    assert cell_heater.read_safety().safe


def test_a_limit_beyond_the_rating_is_refused(fixture: Fixture, cell_heater: Any) -> None:
    """A bench file that allows more than the controller can do is wrong."""
    cell_heater.close()  # some controllers take one client at a time
    limits = {**fixture.limits, "temperature_high": BEYOND_ANY_RATING_DEGC}
    with pytest.raises(InstrumentError):
        fixture.open(limits=limits).programme_limits()


@pytest.mark.parametrize("beyond", ["temperature", "slew", "no rate", "no number"])
def test_what_the_bench_forbids_is_not_tried(
    fixture: Fixture, cell_heater: Any, beyond: str
) -> None:
    """A temperature or a rate beyond the limits, and a ramp that never ends."""
    on(fixture, cell_heater)
    before_degC, high = cell_heater.set_point_degC(), fixture.limits["temperature_high"]
    wanted = {
        "temperature": (high + 0.5, rate(fixture)),
        "slew": (high, 1.5 * fixture.limits["temperature_slew"]),
        "no rate": (high, 0.0),
        "no number": (float("nan"), rate(fixture)),
    }[beyond]
    with pytest.raises(InstrumentError) as raised:
        cell_heater.ramp_to(*wanted)
    assert raised.value.instrument == fixture.name
    assert not cell_heater.is_ramping()
    assert abs(cell_heater.set_point_degC() - before_degC) <= AGREES_K


def test_nothing_is_gone_to_while_the_heater_is_off(fixture: Fixture, cell_heater: Any) -> None:
    """A set-point that nobody controls to would be waited for in vain."""
    cell_heater.programme_limits()
    with pytest.raises(InstrumentError):
        cell_heater.ramp_to(cell_heater.temperature_degC() + RAMP_K, rate(fixture))


def test_it_is_switched_on_where_it_stands(fixture: Fixture, cell_heater: Any) -> None:
    """Switching on moves the temperature of the cell nowhere."""
    cell_heater.programme_limits()
    cell_degC = cell_heater.temperature_degC()
    cell_heater.switch_on()
    assert abs(cell_heater.set_point_degC() - cell_degC) <= NEAR_K
    assert not cell_heater.is_ramping()
    assert not cell_heater.read_safety().safe


def test_a_ramp_takes_its_time_and_the_cell_follows(fixture: Fixture, cell_heater: Any) -> None:
    """What is set is what comes; asking for it returns at once."""
    on(fixture, cell_heater)
    target_degC = cell_heater.set_point_degC() + RAMP_K
    began_s = fixture.clock.now()
    cell_heater.ramp_to(target_degC, rate(fixture))
    assert fixture.clock.now() - began_s <= 5.0, "ramp_to waits for the end of the ramp"
    while cell_heater.is_ramping():
        assert fixture.clock.now() - began_s < 120 * RAMP_K / rate(fixture), "it never ends"
        assert cell_heater.set_point_degC() <= target_degC + AGREES_K
        fixture.clock.sleep(LOOK_S)
    assert abs(fixture.clock.now() - began_s - 60 * RAMP_K / rate(fixture)) <= 2 * LOOK_S
    assert abs(cell_heater.set_point_degC() - target_degC) <= AGREES_K
    while abs(cell_heater.temperature_degC() - target_degC) > NEAR_K:
        assert fixture.clock.now() - began_s < WARMS_WITHIN_S, "the cell stays cold"
        fixture.clock.sleep(LOOK_S)
    assert 0.0 <= cell_heater.power_percent() <= 100.0


@pytest.mark.parametrize("state", STATES)
def test_it_is_off_from_any_state(fixture: Fixture, cell_heater: Any, state: str) -> None:
    """`make_safe` switches the heater off before its deadline and can prove it."""
    STATES[state](fixture, cell_heater)
    deadline_s = fixture.clock.now() + fixture.within_s
    cell_heater.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s, "it came to rest after its deadline"
    reading = cell_heater.read_safety()
    assert reading.safe, reading.read_back
    fixture.clock.sleep(STAYS_S)
    cell_heater.temperature_degC()
    assert cell_heater.read_safety().safe, "a look switches it on again"


@pytest.mark.parametrize("state", ["on", "ramping"])
def test_a_heater_that_controls_reads_back_as_unsafe(
    fixture: Fixture, cell_heater: Any, state: str
) -> None:
    """Nothing is assumed from what was commanded."""
    STATES[state](fixture, cell_heater)
    assert not cell_heater.read_safety().safe
