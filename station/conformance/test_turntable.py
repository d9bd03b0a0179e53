"""What a turntable owes: its limits, its angles through every turn, its rates, and rest."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError

pytestmark = pytest.mark.energises

AXIS = 1
ANGLES_DEG = (40.0, -25.0, 0.0)
TURN_DEG = 360.0
AGREES_DEG = 0.01
RATE_AGREES = 2e-3
LOOK_S = 0.1
HOMES_WITHIN_S = 180.0
MOVES_WITHIN_S = 300.0
BEYOND_ANY_RATING = 1e5
NOISE_DEG_PER_S = 0.05


def wait(fixture: Fixture, table: Any, within_s: float = MOVES_WITHIN_S) -> None:
    """Wait until the axis stands still."""
    until_s = fixture.clock.now() + within_s
    while table.is_moving(AXIS):
        assert fixture.clock.now() < until_s, f"it still moves after {within_s:g} s"
        fixture.clock.sleep(LOOK_S)


def wait_for_rate(fixture: Fixture, table: Any) -> None:
    """Wait until the axis has its rate."""
    until_s = fixture.clock.now() + MOVES_WITHIN_S
    while not table.is_at_rate(AXIS):
        assert fixture.clock.now() < until_s, f"it has no rate after {MOVES_WITHIN_S:g} s"
        fixture.clock.sleep(LOOK_S)


def homed(fixture: Fixture, table: Any) -> None:
    """Have the axis close its servo and find its zero."""
    table.programme_limits()
    table.home(AXIS)
    wait(fixture, table, HOMES_WITHIN_S)


def rate(fixture: Fixture) -> float:
    """Return a rate that is slow for this table."""
    return fixture.limits["rate"] / 5


def goes_round(fixture: Fixture) -> None:
    """Skip a test of whole turns where the bench forbids them."""
    if "angle_low" in fixture.limits or "angle_high" in fixture.limits:
        pytest.skip("the bench limits its angles")


def homing(fixture: Fixture, table: Any) -> None:
    """Let the axis close its servo."""
    table.programme_limits()
    table.home(AXIS)


def turning(fixture: Fixture, table: Any) -> None:
    """Let the axis turn at a rate."""
    homed(fixture, table)
    table.turn(AXIS, rate(fixture))
    fixture.clock.sleep(2.0)


def moving(fixture: Fixture, table: Any) -> None:
    """Let the axis go to an angle."""
    homed(fixture, table)
    away_deg = 40.0 if table.angle_deg(AXIS) < 0 else -40.0
    table.move_to(AXIS, table.angle_deg(AXIS) + away_deg)
    fixture.clock.sleep(0.5)


def refused(fixture: Fixture, table: Any) -> None:
    """Ask for a rate that the bench forbids, while the axis turns."""
    turning(fixture, table)
    with pytest.raises(InstrumentError):
        table.turn(AXIS, BEYOND_ANY_RATING)


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, table: None,
    "limits-programmed": lambda fixture, table: table.programme_limits(),
    "homing": homing,
    "homed": homed,
    "turning": turning,
    "going-to-an-angle": moving,
    "a-request-refused": refused,
}


def test_the_limits_go_into_the_controller(fixture: Fixture, turntable: Any) -> None:
    """The controller's own limits hold when the program does not."""
    turntable.identify()
    assert fixture.heard, "the driver passes nothing to the `trace` of its place"
    fixture.heard.clear()
    turntable.programme_limits()
    sent = [data for _, direction, data in fixture.heard if direction == ">"]
    assert sent, "programme_limits sends nothing"


@pytest.mark.parametrize("limit", ["rate", "acceleration"])
def test_a_limit_beyond_the_rating_is_refused(fixture: Fixture, turntable: Any, limit: str) -> None:
    """A bench file that allows more than the table can do is wrong."""
    turntable.close()  # some controllers take one client at a time
    table = fixture.open(limits={**fixture.limits, limit: BEYOND_ANY_RATING})
    with pytest.raises(InstrumentError):
        table.programme_limits()


def test_nothing_turns_before_it_is_homed(fixture: Fixture, turntable: Any) -> None:
    """A servo that is open follows nothing."""
    turntable.programme_limits()
    if turntable.is_homed(AXIS):
        pytest.skip("it was homed before")
    acts: tuple[Callable[[], object], ...] = (
        lambda: turntable.move_to(AXIS, ANGLES_DEG[0]),
        lambda: turntable.turn(AXIS, rate(fixture)),
    )
    for act in acts:
        with pytest.raises(InstrumentError) as raised:
            act()
        assert raised.value.instrument == fixture.name
    assert not turntable.is_moving(AXIS)


def test_it_goes_to_angles(fixture: Fixture, turntable: Any) -> None:
    """What was commanded is what the encoder reads, once it stands still."""
    homed(fixture, turntable)
    assert turntable.is_homed(AXIS)
    for angle_deg in ANGLES_DEG:
        began_s = fixture.clock.now()
        turntable.move_to(AXIS, angle_deg)
        assert fixture.clock.now() - began_s <= 5.0, "move_to waits for the end of the movement"
        wait(fixture, turntable)
        assert abs(turntable.angle_deg(AXIS) - angle_deg) <= AGREES_DEG


@pytest.mark.parametrize("turns", [1, -2])
def test_whole_turns_go_by_every_angle_between(
    fixture: Fixture, turntable: Any, turns: int
) -> None:
    """A full turn is no standstill, and its sense is the one that was asked for."""
    goes_round(fixture)
    homed(fixture, turntable)
    begin_deg = turntable.angle_deg(AXIS)
    turntable.move_to(AXIS, begin_deg + turns * TURN_DEG)
    seen = [begin_deg]
    while turntable.is_moving(AXIS):
        seen.append(turntable.angle_deg(AXIS))
        fixture.clock.sleep(LOOK_S)
    seen.append(turntable.angle_deg(AXIS))
    assert abs(seen[-1] - begin_deg - turns * TURN_DEG) <= AGREES_DEG
    steps = [(after - before) * turns for before, after in pairwise(seen)]
    assert min(steps) >= -AGREES_DEG * abs(turns), "it turned back on its way"
    assert max(steps) <= 0.7 * TURN_DEG * abs(turns), "it was never seen between"


@pytest.mark.parametrize("sense", [1, -1])
def test_it_turns_at_a_rate_and_counts_its_turns(
    fixture: Fixture, turntable: Any, sense: int
) -> None:
    """The encoder's angle over the clock's time is the rate, also through several turns."""
    goes_round(fixture)
    homed(fixture, turntable)
    wanted = sense * rate(fixture)
    turntable.turn(AXIS, wanted)
    wait_for_rate(fixture, turntable)
    assert turntable.is_moving(AXIS)
    begin_s, begin_deg = fixture.clock.now(), turntable.angle_deg(AXIS)
    fixture.clock.sleep(2.5 * TURN_DEG / abs(wanted))
    end_s, end_deg = fixture.clock.now(), turntable.angle_deg(AXIS)
    assert (end_deg - begin_deg) / (end_s - begin_s) == pytest.approx(wanted, rel=RATE_AGREES)
    assert turntable.rate_deg_per_s(AXIS) == pytest.approx(wanted, abs=NOISE_DEG_PER_S)
    turntable.stop(AXIS)
    assert not turntable.is_at_rate(AXIS)
    wait(fixture, turntable)
    assert abs(turntable.rate_deg_per_s(AXIS)) <= NOISE_DEG_PER_S


def test_what_the_bench_forbids_is_refused(fixture: Fixture, turntable: Any) -> None:
    """Neither a rate nor an angle beyond the bench file is tried."""
    homed(fixture, turntable)
    before_deg = turntable.angle_deg(AXIS)
    for beyond in (1.01 * fixture.limits["rate"], -1.01 * fixture.limits["rate"], float("nan")):
        with pytest.raises(InstrumentError):
            turntable.turn(AXIS, beyond)
    for name, beyond in (("angle_high", 1.0), ("angle_low", -1.0)):
        if name in fixture.limits:
            with pytest.raises(InstrumentError):
                turntable.move_to(AXIS, fixture.limits[name] + beyond)
    assert not turntable.is_moving(AXIS)
    assert abs(turntable.angle_deg(AXIS) - before_deg) <= AGREES_DEG


@pytest.mark.parametrize("state", STATES)
def test_it_comes_to_rest_from_any_state(fixture: Fixture, turntable: Any, state: str) -> None:
    """`make_safe` stops it before its deadline, says so, and the encoder agrees."""
    STATES[state](fixture, turntable)
    deadline_s = fixture.clock.now() + fixture.within_s
    turntable.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s, "it came to rest after its deadline"
    reading = turntable.read_safety()
    assert reading.safe, reading.read_back
    angle_deg = turntable.angle_deg(AXIS)
    fixture.clock.sleep(2.0)
    assert abs(turntable.angle_deg(AXIS) - angle_deg) <= AGREES_DEG


@pytest.mark.parametrize("state", ["turning", "going-to-an-angle"])
def test_a_turning_table_reads_back_as_unsafe(fixture: Fixture, turntable: Any, state: str) -> None:
    """Nothing is assumed from what was commanded."""
    STATES[state](fixture, turntable)
    assert not turntable.read_safety().safe
