"""Eyes of an interlock: a fresh published reading, or else the instrument's own answer."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from station.clock import Clock, ClockError, ClockStopped
from station.errors import InputError, InstrumentError
from station.roles.role import kind_of
from station.safety.interlocks.conditions import Seen, Watched
from station.safety.readings import Reading, Readings, Value

YOUNGER = 0.99
"""A reading made at the last look is not fresh at the next, whatever the last bit says."""


class Monitored(Protocol):
    """An instrument that can be asked for a quantity at any time, between any two exchanges."""

    def read_quantity(self, quantity: str) -> Value | None:
        """Return it now; None while there is nothing to be known, as of a board that is stopped.

        Raises InputError for a quantity that the instrument does not have.
        """
        ...


@dataclass(frozen=True)
class Sight:
    """Look at the quantities of opened instruments; a reading is fresh for `fresh_s`."""

    readings: Readings
    instruments: Mapping[str, object]
    clock: Clock
    fresh_s: float

    def look(self, instrument: str, quantity: str) -> Seen:
        """Return the newest reading while it is fresh, else ask the instrument.

        Raises InputError where the bench file watches what its driver cannot be asked for.
        """
        newest = self.readings.newest(instrument, quantity)
        if newest is not None and self.clock.now() - newest.time_s < YOUNGER * self.fresh_s:
            return Seen(newest)
        read = getattr(self.instruments.get(instrument), "read_quantity", None)
        if read is None:
            raise InputError(
                f"{instrument}: its driver cannot be asked for its {quantity}; take that interlock "
                "out of the bench file"
            )
        try:
            value: Value | None = read(quantity)
        except (ClockStopped, ClockError, InputError):
            raise
        except Exception as error:  # whatever it is, what cannot be read protects nobody
            return Seen(None, f"cannot be read: {error}")
        if value is None:
            return Seen(None, "is not measured now", excused=True)
        told = self.readings.newest(instrument, quantity)
        if told is None or told.value != value or told.time_s != self.clock.now():
            # The driver has not published it by itself.
            unit = kind_of(instrument, quantity).unit
            self.readings.publish(instrument, quantity, value, unit)
            told = Reading(value, unit, self.clock.now())
        return Seen(told)

    def explained(self, watched: Collection[Watched]) -> str:
        """Return in brackets what instruments say to explain a state: which contact is open."""
        said = []
        for instrument, quantity in sorted(watched):
            explain = getattr(self.instruments.get(instrument), "explain", None)
            if explain is not None:
                with suppress(InstrumentError):  # the trip itself is reported all the same
                    said.append(str(explain(quantity)))
        told = ", ".join(one for one in said if one)
        return f" ({told})" if told else ""
