"""What a rotary stage owes: its limits, its zero, its angles, and rest from any movement."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError

pytestmark = pytest.mark.energises

ANGLES_DEG = (30.0, -15.0, 0.0)
FAR_DEG = 90.0
AGREES_DEG = 0.01
LOOK_S = 0.1
HOMES_WITHIN_S = 180.0
MOVES_WITHIN_S = 120.0
BEYOND_ANY_RATING = 1e5
NOISE_DEG_PER_S = 0.05


def wait(fixture: Fixture, stage: Any, within_s: float) -> None:
    """Wait until the stage stands still."""
    until_s = fixture.clock.now() + within_s
    while stage.is_moving():
        assert fixture.clock.now() < until_s, f"it still moves after {within_s:g} s"
        fixture.clock.sleep(LOOK_S)


def homed(fixture: Fixture, stage: Any) -> None:
    """Have the stage find its zero."""
    stage.programme_limits()
    stage.home()
    wait(fixture, stage, HOMES_WITHIN_S)


def within(fixture: Fixture, angle_deg: float) -> float:
    """Return an angle that the bench allows, as near to another as may be."""
    low = fixture.limits.get("angle_low", -360.0)
    high = fixture.limits.get("angle_high", 360.0)
    return min(max(angle_deg, low), high)


def homing(fixture: Fixture, stage: Any) -> None:
    """Let the stage look for its zero."""
    stage.programme_limits()
    stage.home()
    fixture.clock.sleep(1.0)


def turning(fixture: Fixture, stage: Any) -> None:
    """Let the stage turn at its full rate."""
    homed(fixture, stage)
    stage.move_to(within(fixture, FAR_DEG))
    fixture.clock.sleep(1.0)


def refused(fixture: Fixture, stage: Any) -> None:
    """Ask for an angle that the bench forbids, while the stage turns."""
    turning(fixture, stage)
    with pytest.raises(InstrumentError):
        stage.move_to(BEYOND_ANY_RATING)


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, stage: None,
    "limits-programmed": lambda fixture, stage: stage.programme_limits(),
    "homing": homing,
    "homed": homed,
    "turning": turning,
    "a-request-refused": refused,
}


def test_the_limits_go_into_the_controller(fixture: Fixture, rotary_stage: Any) -> None:
    """The controller's own limits hold when the program does not."""
    rotary_stage.identify()
    assert fixture.heard, "the driver passes nothing to the `trace` of its place"
    fixture.heard.clear()
    rotary_stage.programme_limits()
    sent = [data for _, direction, data in fixture.heard if direction == ">"]
    assert sent, "programme_limits sends nothing"


@pytest.mark.parametrize("limit", ["rate", "acceleration"])
def test_a_limit_beyond_the_rating_is_refused(
    fixture: Fixture, rotary_stage: Any, limit: str
) -> None:
    """A bench file that allows more than the stage can do is wrong."""
    rotary_stage.close()  # some controllers take one client at a time
    stage = fixture.open(limits={**fixture.limits, limit: BEYOND_ANY_RATING})
    with pytest.raises(InstrumentError):
        stage.programme_limits()


def test_it_turns_to_no_angle_before_its_zero_is_found(fixture: Fixture, rotary_stage: Any) -> None:
    """An angle without a zero is none."""
    rotary_stage.programme_limits()
    if rotary_stage.is_homed():
        pytest.skip("its zero was found before")
    with pytest.raises(InstrumentError) as raised:
        rotary_stage.move_to(within(fixture, ANGLES_DEG[0]))
    assert raised.value.instrument == fixture.name
    assert not rotary_stage.is_moving()


def test_it_finds_its_zero_and_goes_to_angles(fixture: Fixture, rotary_stage: Any) -> None:
    """What was commanded is what the encoder reads, once it stands still."""
    homed(fixture, rotary_stage)
    assert rotary_stage.is_homed()
    for angle_deg in dict.fromkeys(within(fixture, angle_deg) for angle_deg in ANGLES_DEG):
        began_s = fixture.clock.now()
        rotary_stage.move_to(angle_deg)
        assert fixture.clock.now() - began_s <= 5.0, "move_to waits for the end of the movement"
        wait(fixture, rotary_stage, MOVES_WITHIN_S)
        assert abs(rotary_stage.angle_deg() - angle_deg) <= AGREES_DEG


def test_an_angle_beyond_the_limit_is_refused(fixture: Fixture, rotary_stage: Any) -> None:
    """What the bench file forbids is not tried."""
    beyond = {"angle_high": 1.0, "angle_low": -1.0}
    known = [name for name in beyond if name in fixture.limits]
    if not known:
        pytest.skip("the bench limits no angle")
    homed(fixture, rotary_stage)
    before_deg = rotary_stage.angle_deg()
    for name in known:
        with pytest.raises(InstrumentError):
            rotary_stage.move_to(fixture.limits[name] + beyond[name])
    assert not rotary_stage.is_moving()
    assert abs(rotary_stage.angle_deg() - before_deg) <= AGREES_DEG


def test_it_turns_no_faster_than_its_limit(fixture: Fixture, rotary_stage: Any) -> None:
    """The encoder itself says so, read all along a movement."""
    homed(fixture, rotary_stage)
    rotary_stage.move_to(within(fixture, FAR_DEG))
    seen: list[tuple[float, float]] = []
    while rotary_stage.is_moving():
        seen.append((fixture.clock.now(), rotary_stage.angle_deg()))
        fixture.clock.sleep(LOOK_S)
    rates = [
        abs(after_deg - before_deg) / (after_s - before_s)
        for (before_s, before_deg), (after_s, after_deg) in pairwise(seen)
    ]
    assert rates, "it does not turn"
    # Stamps are made on this side of the line, so a short interval says little.
    allowed = fixture.limits["rate"] * (1.02 if fixture.simulation else 1.2) + NOISE_DEG_PER_S
    assert max(rates) <= allowed, f"{max(rates):.3f} deg/s"


@pytest.mark.parametrize("state", STATES)
def test_it_comes_to_rest_from_any_movement(
    fixture: Fixture, rotary_stage: Any, state: str
) -> None:
    """`make_safe` stops it before its deadline, says so, and the encoder agrees."""
    STATES[state](fixture, rotary_stage)
    deadline_s = fixture.clock.now() + fixture.within_s
    rotary_stage.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s, "it came to rest after its deadline"
    reading = rotary_stage.read_safety()
    assert reading.safe, reading.read_back
    angle_deg = rotary_stage.angle_deg()
    fixture.clock.sleep(2.0)
    assert abs(rotary_stage.angle_deg() - angle_deg) <= AGREES_DEG


def test_a_turning_stage_reads_back_as_unsafe(fixture: Fixture, rotary_stage: Any) -> None:
    """Nothing is assumed from what was commanded."""
    turning(fixture, rotary_stage)
    assert not rotary_stage.read_safety().safe
