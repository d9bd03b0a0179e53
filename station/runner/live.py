"""What a run sets and reads just now, for whoever watches it; the history is in the record."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from station.clock import Clock
from station.method.set_points import BOUNDS, Bounds
from station.roles.role import quantities_of
from station.safety.bounds import upper_limits
from station.safety.readings import Reading, Readings
from station.units import shown, shown_in

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.safety.interlocks.monitor import InterlockLook

NO_QUANTITY = ("sequence", "counter", "number", "valid", "state", "flags", "time_s")
"""Ends of names of columns that say when and whether, not what."""
NAME = re.compile(r"(.+?)_([A-Za-z]+(?:_per_[a-z]+2?)?)")
"""The name of a column: its quantity and its unit."""
MAX_READ = 6
"""Values of one instrument: its first ones, as its driver orders them."""


class LiveBoard:
    """Set-points, the newest values and the interlocks of a run, as texts with units.

    It is written in the thread of the steps and read in those of the channel: every entry is put in
    place whole.
    """

    def __init__(self, clock: Clock, readings: Readings, bench: Bench) -> None:
        self._clock = clock
        self._readings = readings
        self._limits = limits_of(bench)
        self._set: dict[str, tuple[str, Bounds]] = {}
        self._rows: dict[str, tuple[NDArray[Any], float]] = {}
        self.now = ""
        """What goes on within the present step."""
        self.interlocks: Callable[[], Sequence[InterlockLook]] = tuple

    def commanded(self, instrument: str, words: str, bounds: Bounds) -> None:
        """Take note of what was sent to an instrument last."""
        self._set[instrument] = words, bounds

    def came(self, source: str, rows: NDArray[Any]) -> None:
        """Take note of the newest row that a source gave; `rows` has at least one."""
        self._rows[source] = rows[-1], self._clock.now()

    def data(self) -> dict[str, Any]:
        """Return instruments with set-point and values, interlocks, and what goes on at `time_s`.

        A value that is a number has it as `value` in `unit`, with what was commanded, `set`, and
        what it may not exceed, `limit`, where there is such. `age_s` is the run time since it was
        read.
        """
        now_s = self._clock.now()
        read: dict[str, dict[str, Reading]] = {}
        for (instrument, quantity), reading in self._readings.board().items():
            read.setdefault(instrument, {})[quantity] = reading
        for source, (row, time_s) in self._rows.copy().items():
            for name, (value, unit) in columns_of(row).items():
                read.setdefault(source, {})[name] = Reading(value, unit, time_s)
        commanded = self._set.copy()
        return {
            "instruments": [
                {
                    "instrument": name,
                    "set": commanded[name][0] if name in commanded else "",
                    "read": [
                        self._shown(name, quantity, reading, now_s)
                        for quantity, reading in list(read.get(name, {}).items())[:MAX_READ]
                    ],
                }
                for name in sorted({*commanded, *read})
            ],
            "interlocks": [interlock._asdict() for interlock in self.interlocks()],
            "now": self.now,
            "time_s": now_s,
        }

    def _shown(self, name: str, quantity: str, reading: Reading, now_s: float) -> dict[str, Any]:
        value, unit, time_s = reading
        age_s = round(now_s - time_s, 1)
        if isinstance(value, str):
            return {"quantity": quantity, "text": value, "age_s": age_s}
        entry = {"quantity": quantity, "text": shown(value, unit), "age_s": age_s}
        if not math.isfinite(value):
            return entry
        unit, factor = shown_in(unit)
        numbers = {
            "value": value * factor,
            "set": self._commanded(name, quantity, unit),
            "limit": self._limits.get((name, quantity, unit)),
        }
        kept = {key: number for key, number in numbers.items() if number is not None}
        return {**entry, "unit": unit, **kept}

    def _commanded(self, name: str, quantity: str, unit: str) -> float | None:
        """Return how much of a quantity was last commanded of an instrument, None for nothing."""
        _, bounds = self._set.get(name, ("", Bounds()))
        given = (
            bounds.get(key)
            for key, bound in BOUNDS.items()
            if bound.word == quantity and bound.unit == unit
        )
        return next((float(value) for value in given if isinstance(value, int | float)), None)


def limits_of(bench: Bench) -> dict[tuple[str, str, str], float]:
    """Return by instrument, quantity and unit what it may not exceed, at most.

    That is the bench file's limit on it, or the level of an interlock where that is lower.
    """
    most: dict[tuple[str, str, str], float] = {}
    for name, instrument in bench.instruments.items():
        for quantity, kind in quantities_of(name).items():
            ends = (kind.limit, f"{kind.limit}_high") if kind.limit else ()
            for limit in (instrument.limits[key] for key in ends if key in instrument.limits):
                most[name, quantity, kind.unit] = limit
    conditions = [interlock.when for interlock in bench.interlocks]
    for level in upper_limits(conditions, "any"):
        key = level.instrument, level.quantity, level.unit
        most[key] = min(level.high, most.get(key, math.inf))
    return most


def columns_of(row: NDArray[Any]) -> dict[str, tuple[float, str]]:
    """Return the quantities of a row of a record, by name, with their units."""
    from station.roles.base import ARRIVAL

    values = {}
    for column in row.dtype.names or ():
        if column == ARRIVAL or column.endswith(NO_QUANTITY) or row.dtype[column].shape:
            continue
        named = NAME.fullmatch(column)
        quantity, unit = named.groups() if named else (column, "")
        if not math.isnan(value := float(row[column])):  # none in this row
            values[quantity] = value, unit.replace("_per_", "/")
    return values
