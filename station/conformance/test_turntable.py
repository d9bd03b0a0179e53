"""What a turntable owes: its limits, its angles through every turn, its rates, and rest."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from station.conformance.stand import Stand
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


def wait(stand: Stand, table: Any, within_s: float = MOVES_WITHIN_S) -> None:
    """Wait until the axis stands still."""
    until_s = stand.clock.now() + within_s
    while table.is_moving(AXIS):
        assert stand.clock.now() < until_s, f"it still moves after {within_s:g} s"
        stand.clock.sleep(LOOK_S)


def wait_for_rate(stand: Stand, table: Any) -> None:
    """Wait until the axis has its rate."""
    until_s = stand.clock.now() + MOVES_WITHIN_S
    while not table.is_at_rate(AXIS):
        assert stand.clock.now() < until_s, f"it has no rate after {MOVES_WITHIN_S:g} s"
        stand.clock.sleep(LOOK_S)


def homed(stand: Stand, table: Any) -> None:
    """Have the axis close its servo and find its zero."""
    table.programme_limits()
    table.home(AXIS)
    wait(stand, table, HOMES_WITHIN_S)


def rate(stand: Stand) -> float:
    """Return a rate that is slow for this table."""
    return stand.limits["rate"] / 5


def goes_round(stand: Stand) -> None:
    """Skip a test of whole turns where the bench forbids them."""
    if "angle_low" in stand.limits or "angle_high" in stand.limits:
        pytest.skip("the bench limits its angles")


def homing(stand: Stand, table: Any) -> None:
    """Let the axis close its servo."""
    table.programme_limits()
    table.home(AXIS)


def turning(stand: Stand, table: Any) -> None:
    """Let the axis turn at a rate."""
    homed(stand, table)
    table.turn(AXIS, rate(stand))
    stand.clock.sleep(2.0)


def moving(stand: Stand, table: Any) -> None:
    """Let the axis go to an angle."""
    homed(stand, table)
    away_deg = 40.0 if table.angle_deg(AXIS) < 0 else -40.0
    table.move_to(AXIS, table.angle_deg(AXIS) + away_deg)
    stand.clock.sleep(0.5)


def refused(stand: Stand, table: Any) -> None:
    """Ask for a rate that the bench forbids, while the axis turns."""
    turning(stand, table)
    with pytest.raises(InstrumentError):
        table.turn(AXIS, BEYOND_ANY_RATING)


STATES: dict[str, Callable[[Stand, Any], None]] = {
    "just-opened": lambda stand, table: None,
    "limits-programmed": lambda stand, table: table.programme_limits(),
    "homing": homing,
    "homed": homed,
    "turning": turning,
    "going-to-an-angle": moving,
    "a-request-refused": refused,
}


def test_the_limits_go_into_the_controller(stand: Stand, turntable: Any) -> None:
    """The controller's own limits hold when the program does not."""
    turntable.identify()
    assert stand.heard, "the driver tells its place's `trace` nothing"
    stand.heard.clear()
    turntable.programme_limits()
    sent = [data for _, direction, data in stand.heard if direction == ">"]
    assert sent, "programme_limits sends nothing"


@pytest.mark.parametrize("limit", ["rate", "acceleration"])
def test_a_limit_beyond_the_rating_is_refused(stand: Stand, turntable: Any, limit: str) -> None:
    """A bench file that allows more than the table can do is wrong."""
    turntable.close()  # some controllers take one client at a time
    table = stand.open(limits={**stand.limits, limit: BEYOND_ANY_RATING})
    with pytest.raises(InstrumentError):
        table.programme_limits()


def test_nothing_turns_before_it_is_homed(stand: Stand, turntable: Any) -> None:
    """A servo that is open follows nothing."""
    turntable.programme_limits()
    if turntable.is_homed(AXIS):
        pytest.skip("it was homed before")
    acts: tuple[Callable[[], object], ...] = (
        lambda: turntable.move_to(AXIS, ANGLES_DEG[0]),
        lambda: turntable.turn(AXIS, rate(stand)),
    )
    for act in acts:
        with pytest.raises(InstrumentError) as raised:
            act()
        assert raised.value.instrument == stand.name
    assert not turntable.is_moving(AXIS)


def test_it_goes_to_angles(stand: Stand, turntable: Any) -> None:
    """What was commanded is what the encoder reads, once it stands still."""
    homed(stand, turntable)
    assert turntable.is_homed(AXIS)
    for angle_deg in ANGLES_DEG:
        began_s = stand.clock.now()
        turntable.move_to(AXIS, angle_deg)
        assert stand.clock.now() - began_s <= 5.0, "move_to waits for the end of the movement"
        wait(stand, turntable)
        assert abs(turntable.angle_deg(AXIS) - angle_deg) <= AGREES_DEG


@pytest.mark.parametrize("turns", [1, -2])
def test_whole_turns_go_by_every_angle_between(stand: Stand, turntable: Any, turns: int) -> None:
    """A full turn is no standstill, and its sense is the one that was asked for."""
    goes_round(stand)
    homed(stand, turntable)
    begin_deg = turntable.angle_deg(AXIS)
    turntable.move_to(AXIS, begin_deg + turns * TURN_DEG)
    seen = [begin_deg]
    while turntable.is_moving(AXIS):
        seen.append(turntable.angle_deg(AXIS))
        stand.clock.sleep(LOOK_S)
    seen.append(turntable.angle_deg(AXIS))
    assert abs(seen[-1] - begin_deg - turns * TURN_DEG) <= AGREES_DEG
    steps = [(after - before) * turns for before, after in pairwise(seen)]
    assert min(steps) >= -AGREES_DEG * abs(turns), "it turned back on its way"
    assert max(steps) <= 0.7 * TURN_DEG * abs(turns), "it was never seen between"


@pytest.mark.parametrize("sense", [1, -1])
def test_it_turns_at_a_rate_and_counts_its_turns(stand: Stand, turntable: Any, sense: int) -> None:
    """The encoder's angle over the clock's time is the rate, also through several turns."""
    goes_round(stand)
    homed(stand, turntable)
    wanted = sense * rate(stand)
    turntable.turn(AXIS, wanted)
    wait_for_rate(stand, turntable)
    assert turntable.is_moving(AXIS)
    begin_s, begin_deg = stand.clock.now(), turntable.angle_deg(AXIS)
    stand.clock.sleep(2.5 * TURN_DEG / abs(wanted))
    end_s, end_deg = stand.clock.now(), turntable.angle_deg(AXIS)
    assert (end_deg - begin_deg) / (end_s - begin_s) == pytest.approx(wanted, rel=RATE_AGREES)
    assert turntable.rate_deg_per_s(AXIS) == pytest.approx(wanted, abs=NOISE_DEG_PER_S)
    turntable.stop(AXIS)
    assert not turntable.is_at_rate(AXIS)
    wait(stand, turntable)
    assert abs(turntable.rate_deg_per_s(AXIS)) <= NOISE_DEG_PER_S


def test_what_the_bench_forbids_is_refused(stand: Stand, turntable: Any) -> None:
    """Neither a rate nor an angle beyond the bench file is tried."""
    homed(stand, turntable)
    before_deg = turntable.angle_deg(AXIS)
    for beyond in (1.01 * stand.limits["rate"], -1.01 * stand.limits["rate"], float("nan")):
        with pytest.raises(InstrumentError):
            turntable.turn(AXIS, beyond)
    for name, beyond in (("angle_high", 1.0), ("angle_low", -1.0)):
        if name in stand.limits:
            with pytest.raises(InstrumentError):
                turntable.move_to(AXIS, stand.limits[name] + beyond)
    assert not turntable.is_moving(AXIS)
    assert abs(turntable.angle_deg(AXIS) - before_deg) <= AGREES_DEG


@pytest.mark.parametrize("state", STATES)
def test_it_comes_to_rest_from_any_state(stand: Stand, turntable: Any, state: str) -> None:
    """`make_safe` stops it before its deadline, says so, and the encoder agrees."""
    STATES[state](stand, turntable)
    deadline_s = stand.clock.now() + stand.within_s
    turntable.make_safe(deadline_s)
    assert stand.clock.now() <= deadline_s, "it came to rest after its deadline"
    reading = turntable.read_safety()
    assert reading.safe, reading.read_back
    angle_deg = turntable.angle_deg(AXIS)
    stand.clock.sleep(2.0)
    assert abs(turntable.angle_deg(AXIS) - angle_deg) <= AGREES_DEG


@pytest.mark.parametrize("state", ["turning", "going-to-an-angle"])
def test_a_turning_table_reads_back_as_unsafe(stand: Stand, turntable: Any, state: str) -> None:
    """Nothing is assumed from what was commanded."""
    STATES[state](stand, turntable)
    assert not turntable.read_safety().safe
