"""What the shutter of the pump light owes: it proves where it stands, and closes from any state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from station.conformance.fixture import Fixture

pytestmark = pytest.mark.energises

STAYS_S = 2.0


def closed_again(fixture: Fixture, shutter: Any) -> None:
    """Open the shutter and close it."""
    shutter.open_shutter()
    shutter.close_shutter()


def from_following_to_open(fixture: Fixture, shutter: Any) -> None:
    """Let it follow the trigger, then open it by command."""
    shutter.follow_trigger()
    shutter.open_shutter()


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, shutter: None,
    "open": lambda fixture, shutter: shutter.open_shutter(),
    "closed": closed_again,
    "following": lambda fixture, shutter: shutter.follow_trigger(),
    "open-after-following": from_following_to_open,
}


def test_it_opens_and_closes_and_proves_it(fixture: Fixture, pump_laser: Any) -> None:
    """Each act is done when it returns, and stays."""
    for _ in range(2):
        pump_laser.open_shutter()
        assert pump_laser.is_open()
        fixture.clock.sleep(STAYS_S)
        assert pump_laser.is_open()
        pump_laser.close_shutter()
        assert not pump_laser.is_open()
        fixture.clock.sleep(STAYS_S)
        assert not pump_laser.is_open()


def test_an_act_that_was_done_does_not_undo_itself(pump_laser: Any) -> None:
    """What toggles in the instrument does not toggle here."""
    for act, is_open in (
        (pump_laser.open_shutter, True),
        (pump_laser.close_shutter, False),
        (pump_laser.follow_trigger, True),
    ):
        for _ in range(3):
            act()
            assert pump_laser.is_open() is is_open


@pytest.mark.parametrize("state", STATES)
def test_it_is_closed_from_any_state(fixture: Fixture, pump_laser: Any, state: str) -> None:
    """`make_safe` closes it before its deadline, and its sensor says so."""
    STATES[state](fixture, pump_laser)
    deadline_s = fixture.clock.now() + fixture.within_s
    pump_laser.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s
    reading = pump_laser.read_safety()
    assert reading.safe, reading.read_back
    assert not pump_laser.is_open()
    fixture.clock.sleep(STAYS_S)
    assert not pump_laser.is_open()


@pytest.mark.parametrize("state", ["open", "following"])
def test_light_that_passes_reads_back_as_unsafe(
    fixture: Fixture, pump_laser: Any, state: str
) -> None:
    """Nothing is assumed from what was commanded."""
    STATES[state](fixture, pump_laser)
    assert not pump_laser.read_safety().safe
