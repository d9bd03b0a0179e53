"""The newest reading of every quantity of a run, published by whoever asked the instrument."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from station.clock import Clock

Value = float | str
Publisher = Callable[[str, Value, str], None]
"""Takes a quantity, its value (a number, or a word for a state) and the unit of a number."""


class Reading(NamedTuple):
    """What an instrument said of a quantity, and the run time in s at which it said so."""

    value: Value
    unit: str
    time_s: float


class Readings:
    """The board on which drivers publish; interlocks and the panel look there before they ask.

    Only the newest reading of each quantity is kept: the history is in the raw record.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._newest: dict[tuple[str, str], Reading] = {}
        self._told: list[Callable[[str, str, str], None]] = []

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

    def newest(self, instrument: str, quantity: str) -> Reading | None:
        """Return the newest reading, or None where nothing was published yet."""
        return self._newest.get((instrument, quantity))

    def on_change(self, tell: Callable[[str, str, str], None]) -> None:
        """Call `tell(instrument, quantity, state)` whenever a state becomes another one.

        It is called in the thread that published, and must return at once.
        """
        self._told.append(tell)
