"""The log of a run: whatever is done to its lines shows, and what a crash tore is no damage."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.errors import DamagedRecord
from station.record.events import FIRST_HASH, Event, EventLog, read_events

NAMES = st.text(min_size=1, max_size=6).filter(
    lambda name: name not in ("t_s", "event", "previous")
)
VALUES = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False)
)
DETAILS = st.dictionaries(NAMES, VALUES | st.text(max_size=8) | st.lists(VALUES, max_size=2))
EVENTS = st.lists(
    st.builds(Event, st.floats(0.0, 1e7).map(lambda time_s: round(time_s, 9)), NAMES, DETAILS),
    min_size=2,
    max_size=6,
)


def written(events: list[Event], before: bytes = b"") -> bytes:
    """Return the bytes of a log that has these events behind what was there before."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "events.jsonl"
        if before:
            path.write_bytes(before)
        log = EventLog(path)
        for event in events:
            log.append(event.time_s, event.kind, event.details, durable=False)
        log.close()
        return path.read_bytes()


def read(log: bytes) -> list[Event]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "events.jsonl"
        path.write_bytes(log)
        return list(read_events(path))


@given(EVENTS)
def test_a_log_is_read_as_it_was_written(events: list[Event]) -> None:
    assert read(written(events)) == events


@given(EVENTS, EVENTS, st.data())
def test_a_torn_last_line_is_left_out_and_the_log_goes_on_behind_the_others(
    events: list[Event], more: list[Event], drawn: st.DataObject
) -> None:
    log = written(events)
    last = len(log.splitlines(keepends=True)[-1])
    torn = log[: len(log) - drawn.draw(st.integers(1, last))]
    assert read(torn) == events[:-1]
    assert read(written(more, before=torn)) == [*events[:-1], *more]


def altered(lines: list[bytes], draw: st.DrawFn) -> list[bytes]:
    """Return lines of which one, but the last, has another byte."""
    number = draw(st.integers(0, len(lines) - 2))
    place = draw(st.integers(0, len(lines[number]) - 1))
    line = bytearray(lines[number])
    line[place] ^= draw(st.integers(1, 255))
    return [*lines[:number], bytes(line), *lines[number + 1 :]]


def dropped(lines: list[bytes], draw: st.DrawFn) -> list[bytes]:
    """Return lines of which one, but the last, is missing."""
    number = draw(st.integers(0, len(lines) - 2))
    return [*lines[:number], *lines[number + 1 :]]


def exchanged(lines: list[bytes], draw: st.DrawFn) -> list[bytes]:
    """Return lines of which two stand in each other's place."""
    one, other = draw(st.lists(st.integers(0, len(lines) - 1), min_size=2, max_size=2, unique=True))
    changed = list(lines)
    changed[one], changed[other] = lines[other], lines[one]
    return changed


def inserted(lines: list[bytes], draw: st.DrawFn) -> list[bytes]:
    """Return lines with one more: one of themselves, or the first of another log."""
    place = draw(st.integers(0, len(lines) - 1))
    foreign: dict[str, Any] = {"t_s": 0.0, "event": "unit-finished", "previous": FIRST_HASH}
    line = draw(st.sampled_from([*lines, json.dumps(foreign).encode() + b"\n"]))
    return [*lines[:place], line, *lines[place:]]


@pytest.mark.parametrize("tamper", [altered, dropped, exchanged, inserted])
@given(events=EVENTS, drawn=st.data())
def test_a_line_that_is_altered_dropped_exchanged_or_inserted_is_seen(
    tamper: Any, events: list[Event], drawn: st.DataObject
) -> None:
    changed = tamper(written(events).splitlines(keepends=True), drawn.draw)
    with pytest.raises(DamagedRecord, match="the log was altered"):
        read(b"".join(changed))
