"""What a run sets and reads just now, for whoever watches it; the history is in the record."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from station.clock import Clock
from station.safety.readings import Readings
from station.units import shown

if TYPE_CHECKING:
    from numpy.typing import NDArray

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

    def __init__(self, clock: Clock, readings: Readings) -> None:
        self._clock = clock
        self._readings = readings
        self._set: dict[str, str] = {}
        self._rows: dict[str, tuple[NDArray[Any], float]] = {}
        self.now = ""
        """What goes on within the present step."""
        self.interlocks: Callable[[], Sequence[InterlockLook]] = tuple

    def commanded(self, instrument: str, words: str) -> None:
        """Take note of what was sent to an instrument last."""
        self._set[instrument] = words

    def came(self, source: str, rows: NDArray[Any]) -> None:
        """Take note of the newest row that a source gave; `rows` has at least one."""
        self._rows[source] = rows[-1], self._clock.now()

    def data(self) -> dict[str, Any]:
        """Return instruments with set-point and values, interlocks, and what goes on at `time_s`.

        `age_s` is the run time since a value was read.
        """
        now_s = self._clock.now()
        read: dict[str, dict[str, tuple[str, float]]] = {}
        for (instrument, quantity), reading in self._readings.board().items():
            text = value_text(reading.value, reading.unit)
            read.setdefault(instrument, {})[quantity] = text, reading.time_s
        for source, (row, time_s) in self._rows.copy().items():
            for name, text in columns_of(row).items():
                read.setdefault(source, {})[name] = text, time_s
        commanded = self._set.copy()
        return {
            "instruments": [
                {
                    "instrument": name,
                    "set": commanded.get(name, ""),
                    "read": [
                        {"quantity": quantity, "text": text, "age_s": round(now_s - at_s, 1)}
                        for quantity, (text, at_s) in list(read.get(name, {}).items())[:MAX_READ]
                    ],
                }
                for name in sorted({*commanded, *read})
            ],
            "interlocks": [interlock._asdict() for interlock in self.interlocks()],
            "now": self.now,
            "time_s": now_s,
        }


def columns_of(row: NDArray[Any]) -> dict[str, str]:
    """Return the quantities of a row of a record, by name, as texts with units."""
    from station.roles.base import ARRIVAL

    texts = {}
    for column in row.dtype.names or ():
        if column == ARRIVAL or column.endswith(NO_QUANTITY) or row.dtype[column].shape:
            continue
        named = NAME.fullmatch(column)
        quantity, unit = named.groups() if named else (column, "")
        if not math.isnan(value := float(row[column])):  # none in this row
            texts[quantity] = value_text(value, unit.replace("_per_", "/"))
    return texts


def value_text(value: float | str, unit: str) -> str:
    """Return a value with its unit: a few digits show what goes on, the record has them all."""
    return value if isinstance(value, str) else shown(value, unit)
