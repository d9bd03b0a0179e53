"""What a digitizer owes: one whole record about each trigger that it gives, and rest from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError

pytestmark = pytest.mark.energises

RATE_HZ = 10e3
DURATION_S = 0.05
FULL_SCALE_V = 1.0
POLL_S = 0.02
AT_ONCE_S = 3.0
"""A few exchanges of at most half a second."""

RECORD_WITHIN_S = 10.0
EARLIEST_SHARE = 0.5
"""A record begins before the trigger, by less than this share of its length."""

BEYOND_ANY_RANGE_V = 1e6
BEYOND_ANY_RATE_HZ = 1e15
BEYOND_ANY_MEMORY_S = 1e9


def fired(fixture: Fixture, digitizer: Any) -> None:
    """Give a trigger, with its record under way."""
    digitizer.prepare(RATE_HZ, DURATION_S, FULL_SCALE_V)
    digitizer.fire()


def record(fixture: Fixture, digitizer: Any) -> Any:
    """Return the block of the record that was fired."""
    until_s = fixture.clock.now() + RECORD_WITHIN_S
    while True:
        began_s = fixture.clock.now()
        block = digitizer.fetch()
        assert fixture.clock.now() - began_s <= AT_ONCE_S, "fetch waits instead of saying None"
        if block is not None:
            return block
        assert fixture.clock.now() < until_s, f"no record after {RECORD_WITHIN_S:g} s"
        fixture.clock.sleep(POLL_S)


def recorded(fixture: Fixture, digitizer: Any) -> None:
    """Fetch a record, and leave the trigger as it is."""
    fired(fixture, digitizer)
    record(fixture, digitizer)


def refused(fixture: Fixture, digitizer: Any) -> None:
    """Ask for what cannot be, while a trigger stands."""
    fired(fixture, digitizer)
    with pytest.raises(InstrumentError):
        digitizer.prepare(RATE_HZ, DURATION_S, BEYOND_ANY_RANGE_V)


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, digitizer: None,
    "prepared": lambda fixture, digitizer: digitizer.prepare(RATE_HZ, DURATION_S, FULL_SCALE_V),
    "fired": fired,
    "recorded": recorded,
    "a-request-refused": refused,
}


def test_it_samples_at_least_as_fast_as_was_asked(digitizer: Any) -> None:
    """The rate that comes back is at or above the wanted."""
    for rate_Hz in (3e3, RATE_HZ, 100e3):
        assert digitizer.prepare(rate_Hz, 100 / rate_Hz, FULL_SCALE_V) >= rate_Hz * (1 - 1e-9)


@pytest.mark.parametrize(
    "wish",
    [
        (BEYOND_ANY_RATE_HZ, DURATION_S, FULL_SCALE_V),
        (RATE_HZ, BEYOND_ANY_MEMORY_S, FULL_SCALE_V),
        (RATE_HZ, DURATION_S, BEYOND_ANY_RANGE_V),
        (0.0, DURATION_S, FULL_SCALE_V),
    ],
    ids=["rate", "duration", "range", "no-rate"],
)
def test_what_it_cannot_hold_is_refused(digitizer: Any, wish: tuple[float, float, float]) -> None:
    """A record that would be cut, too slow or clipped is not begun."""
    with pytest.raises(InstrumentError):
        digitizer.prepare(*wish)


def test_nothing_is_fired_or_fetched_before_it_is_prepared(digitizer: Any) -> None:
    """A trigger without a record would start the rest of the bench for nothing."""
    with pytest.raises(InstrumentError):
        digitizer.fire()
    with pytest.raises(InstrumentError):
        digitizer.fetch()


def test_each_trigger_brings_one_whole_record(fixture: Fixture, digitizer: Any) -> None:
    """Equal steps from a little before the trigger to the end of what was asked for, twice."""
    rate_Hz = digitizer.prepare(RATE_HZ, DURATION_S, FULL_SCALE_V)
    for _ in range(2):
        digitizer.fire()
        block = record(fixture, digitizer)
        digitizer.release()
        assert list(block.columns) == list(digitizer.columns)
        for name, values in block.columns.items():
            assert digitizer.columns[name].strip(), f"{name}: unit and meaning are missing"
            assert values.shape == (len(block),), name
            assert np.isfinite(values).all(), name
        time_s = block.columns["time_s"]
        assert np.diff(time_s) == pytest.approx(1 / rate_Hz, rel=1e-6)
        assert -EARLIEST_SHARE * DURATION_S <= time_s[0] < 0.0, "it does not begin before zero"
        assert time_s[-1] >= DURATION_S * (1 - 1e-9), "its end is missing"
        assert (block.arrival_time_s <= fixture.clock.now()).all()
        with pytest.raises(InstrumentError):
            digitizer.fetch()


def test_a_trigger_that_was_not_released_is_not_given_again(
    fixture: Fixture, digitizer: Any
) -> None:
    """An output that is on already has no edge: nothing would start."""
    recorded(fixture, digitizer)
    with pytest.raises(InstrumentError):
        digitizer.fire()
    digitizer.release()
    digitizer.fire()


@pytest.mark.parametrize("state", STATES)
def test_its_trigger_output_comes_to_rest_from_any_state(
    fixture: Fixture, digitizer: Any, state: str
) -> None:
    """`make_safe` takes it back before its deadline, and reading back says so."""
    STATES[state](fixture, digitizer)
    deadline_s = fixture.clock.now() + fixture.within_s
    digitizer.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s
    reading = digitizer.read_safety()
    assert reading.safe, reading.read_back


def test_a_trigger_that_stands_reads_back_as_unsafe(fixture: Fixture, digitizer: Any) -> None:
    """Nothing is assumed from what was commanded."""
    fired(fixture, digitizer)
    assert not digitizer.read_safety().safe
