"""Eyes of an interlock: a fresh published reading, or else the instrument's own answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from station.clock import Clock, ClockError, ClockStopped
from station.readings import Reading, Readings, Value
from station.safety.interlocks.conditions import Seen
from station.safety.interlocks.quantities import kind_of

YOUNGER = 0.99
"""A reading made at the last look is not fresh at the next, whatever the last bit says."""


@runtime_checkable
class Monitored(Protocol):
    """An instrument that can be asked for a quantity at any time, between any two exchanges."""

    def read_quantity(self, quantity: str) -> Value | None:
        """Return it now; None while there is nothing to be known, as of a board that is stopped."""
        ...


@dataclass(frozen=True)
class Sight:
    """Look at the quantities of opened instruments; a reading is fresh for `fresh_s`."""

    readings: Readings
    instruments: Mapping[str, object]
    clock: Clock
    fresh_s: float

    def look(self, instrument: str, quantity: str) -> Seen:
        """Return the newest reading while it is fresh, else ask the instrument."""
        newest = self.readings.newest(instrument, quantity)
        if newest is not None and self.clock.now() - newest.time_s < YOUNGER * self.fresh_s:
            return Seen(newest)
        asked = self.instruments[instrument]
        if not isinstance(asked, Monitored):
            return Seen(None, f"cannot be read: {type(asked).__name__} has no read_quantity")
        try:
            value = asked.read_quantity(quantity)
        except (ClockStopped, ClockError):
            raise
        except Exception as error:  # whatever it is, what cannot be read protects nobody
            return Seen(None, f"cannot be read: {error}")
        if value is None:
            return Seen(None, "is not measured now", excused=True)
        unit = kind_of(instrument, quantity).unit
        self.readings.publish(instrument, quantity, value, unit)
        return Seen(Reading(value, unit, self.clock.now()))
