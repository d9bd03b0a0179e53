"""The newest reading of every quantity of a run, published by whoever asked the instrument."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from threading import Lock
from typing import Any, NamedTuple

from station.clock import Clock

Value = float | str
Publisher = Callable[[str, Value, str], None]
"""Takes a quantity, its value (a number, or a word for a state) and the unit of a number."""


class Reading(NamedTuple):
    """What an instrument said of a quantity, and the run time in s at which it said so."""

    value: Value
    unit: str
    time_s: float


MAX_NOTES = 200
"""Between two looks of the run at what drivers have noted."""


class DriverNote(NamedTuple):
    """What a driver has to say of its line, and the run time in s at which it happened."""

    instrument: str
    kind: str
    details: Mapping[str, Any]
    time_s: float


class Readings:
    """The board on which drivers publish; interlocks and the panel look there before they ask.

    Only the newest reading of each quantity is kept: the history is in the raw record.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._newest: dict[tuple[str, str], Reading] = {}
        self._told: list[Callable[[str, str, str], None]] = []
        self._notes: deque[DriverNote] = deque()
        self._dropped = 0
        self._notes_lock = Lock()

    def publish(self, instrument: str, quantity: str, value: Value, unit: str = "") -> None:
        """Put up a reading that was made just now."""
        key = instrument, quantity
        before = self._newest.get(key)
        self._newest[key] = Reading(value, unit, self._clock.now())
        if isinstance(value, str) and (before is None or before.value != value):
            for tell in self._told:
                tell(instrument, quantity, value)

    def publisher(self, instrument: str) -> Publisher:
        """Return what the driver of an instrument publishes with."""

        def publish(quantity: str, value: Value, unit: str) -> None:
            self.publish(instrument, quantity, value, unit)

        return publish

    def noter(self, instrument: str) -> Callable[[str, Mapping[str, Any]], None]:
        """Return what the driver of an instrument notes events with; it never waits."""

        def note(kind: str, details: Mapping[str, Any]) -> None:
            entry = DriverNote(instrument, kind, dict(details), self._clock.now())
            with self._notes_lock:
                if len(self._notes) < MAX_NOTES:
                    self._notes.append(entry)
                else:
                    self._dropped += 1

        return note

    def take_notes(self) -> tuple[list[DriverNote], int]:
        """Return what was noted since the last look, and how many more there was no room for."""
        if not self._notes:
            return [], 0
        with self._notes_lock:
            notes, dropped = list(self._notes), self._dropped
            self._notes.clear()
            self._dropped = 0
        return notes, dropped

    def newest(self, instrument: str, quantity: str) -> Reading | None:
        """Return the newest reading, or None where nothing was published yet."""
        return self._newest.get((instrument, quantity))

    def board(self) -> dict[tuple[str, str], Reading]:
        """Return the newest reading of everything, by instrument and quantity."""
        return self._newest.copy()

    def on_change(self, tell: Callable[[str, str, str], None]) -> None:
        """Call `tell(instrument, quantity, state)` whenever a state becomes another one.

        It is called in the thread that published, and must return at once.
        """
        self._told.append(tell)
