"""The reading buffers of a Keithley DMM6500: TRACe.

From public notes that quote the manual DMM6500-901-01 (7-7, 13-175 to 13-203) and from the manual
of the 2461 of the same family (6-156 to 6-177): two buffers that are always there, hold 100,000
readings and overwrite the oldest, others that are made by name, hold 10 at least and stop when they
are full, with event 4915; event 1115 for a name that is taken; a changed size or fill mode empties
a buffer; statistics cover what was overwritten, too. Left out: buffers for data from outside, and
the elements FORMatted, UNIT, STATus and EXTRa. Assumed: that statistics of an empty buffer are
refused with -230, that a default buffer cannot be deleted with -224, and how dates are written.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from datetime import datetime

import numpy as np

from sim_instruments.wire.scpi import (
    ScpiError,
    choice,
    single_parameter,
    unquoted,
    whole_number,
    word,
    words,
)
from sim_instruments.wire.scpi_device import Listed, Value
from sim_instruments.world.piecewise import Array

FIRST, SECOND = "defbuffer1", "defbuffer2"
CAPACITY, LEAST, MOST = 100_000, 10, 7_000_020
TAKEN_NAME, FULL = 1115, 4915
TEXTS = {
    TAKEN_NAME: "Parameter error: TRACe:MAKE cannot take an existing reading buffer name",
    FULL: "Attempting to store past capacity of reading buffer",
}
ELEMENTS = ("READing", "RELative", "SEConds", "FRACtional", "TIME", "DATE", "TSTamp")


class Buffer:
    """Readings with their times, and statistics of all that came."""

    def __init__(self, capacity: int, *, once: bool) -> None:
        self.capacity, self.once = capacity, once
        self.clear()

    def clear(self) -> None:
        """Forget the readings and the statistics."""
        self.values, self._times_s, self._came = np.empty(0), np.empty(0), 0
        self.clear_statistics()

    def clear_statistics(self) -> None:
        """Begin the statistics anew."""
        self._counted, self._sum, self._squares = 0, 0.0, 0.0
        self._least, self._most, self._shift = math.inf, -math.inf, 0.0

    @property
    def first(self) -> int:
        """The index of the oldest reading, 0 without one."""
        return self._came - len(self.values) + bool(len(self.values))

    @property
    def last(self) -> int:
        """The index of the newest reading."""
        return self._came

    def add(self, values: Array, times_s: Array) -> bool:
        """Take readings; return whether all were stored."""
        room = self.capacity - len(self.values) if self.once else len(values)
        stored, stored_s = values[:room], times_s[:room]
        if len(stored):
            self._shift = self._shift if self._counted else float(stored[0])
            apart = stored - self._shift
            self._counted += len(stored)
            self._sum += float(apart.sum())
            self._squares += float((apart**2).sum())
            self._least = min(self._least, float(stored.min()))
            self._most = max(self._most, float(stored.max()))
            self._came += len(stored)
            self.values = np.concatenate([self.values, stored])[-self.capacity :]
            self._times_s = np.concatenate([self._times_s, stored_s])[-self.capacity :]
        return len(stored) == len(values)

    def statistics(self) -> dict[str, float]:
        """Return the statistics; ScpiError -230 without a reading."""
        if not self._counted:
            raise ScpiError(-230)
        mean = self._sum / self._counted
        spread = self._squares - self._counted * mean**2
        return {
            "AVERage": self._shift + mean,
            "MINimum": self._least,
            "MAXimum": self._most,
            "PK2Pk": self._most - self._least,
            "STDDev": math.sqrt(max(spread, 0.0) / max(self._counted - 1, 1)),
        }

    def part(self, first: int, last: int) -> tuple[Array, Array, float]:
        """Return readings by their indices, their times, and the time of the oldest."""
        if not max(self.first, 1) <= first <= last <= self.last:
            raise ScpiError(-222)
        part = slice(first - self.first, last - self.first + 1)
        return self.values[part], self._times_s[part], float(self._times_s[0])


class Buffers:
    """All buffers by name; `date` tells the date and time of a moment of the world."""

    def __init__(self, date: Callable[[float], datetime]) -> None:
        self._date = date
        self.reset()

    def reset(self) -> None:
        """Have the two default buffers only, empty."""
        self._all = {name: Buffer(CAPACITY, once=False) for name in (FIRST, SECOND)}
        self._active = FIRST

    def named(self, parameters: Sequence[str]) -> Buffer:
        """Return the buffer whose name is the only parameter, `defbuffer1` without one."""
        name = unquoted(single_parameter(list(parameters))) if parameters else FIRST
        kept = {known.lower(): buffer for known, buffer in self._all.items()}
        if name.lower() not in kept:
            raise ScpiError(-224)
        return kept[name.lower()]

    def newest(self, parameters: list[str]) -> str:
        """Return the newest reading of a buffer that is named, with elements that are."""
        buffer = self.named(parameters[:1])
        return self._written(buffer, buffer.last, buffer.last, parameters[1:])

    def commands(self) -> dict[str, Value]:
        """Return the table of TRACe."""
        table: dict[str, Value] = {
            "MAKE": Listed(self._make),
            "DELete": Listed(self._delete),
            "CLEar": Listed(lambda given: self.named(given).clear()),
            "ACTual": Listed(None, lambda given: str(len(self.named(given).values))),
            "ACTual:STARt": Listed(None, lambda given: str(self.named(given).first)),
            "ACTual:END": Listed(None, lambda given: str(self.named(given).last)),
            "POINts": Listed(self._resize, lambda given: str(self.named(given).capacity)),
            "FILL:MODE": Listed(
                self._fill, lambda given: "ONCE" if self.named(given).once else "CONT"
            ),
            "DATA": Listed(None, self._data),
            "STATistics:CLEar": Listed(lambda given: self.named(given).clear_statistics()),
        }
        for which in ("AVERage", "MINimum", "MAXimum", "PK2Pk", "STDDev"):
            table[f"STATistics:{which}"] = Listed(
                None,
                lambda given, which=which: (  # type: ignore[misc]
                    f"{self.named(given).statistics()[which]:.6E}"
                ),
            )
        return table

    def display(self) -> dict[str, Value]:
        """Return which buffer is shown."""
        return {"BUFFer:ACTive": (self._activate, lambda: self._active)}

    def _activate(self, text: str) -> None:
        self.named([text])
        self._active = unquoted(text)

    def _make(self, parameters: list[str]) -> None:
        if len(parameters) < 2:
            raise ScpiError(-109)
        if style := [text for text in parameters[2:] if text]:
            choice(single_parameter(style), words("STANdard", "FULL", "COMPact"))
        name, size = unquoted(parameters[0]), whole_number(parameters[1], LEAST, MOST)
        if name.lower() in map(str.lower, self._all):
            raise ScpiError(TAKEN_NAME)
        self._all[name], self._active = Buffer(size, once=True), name

    def _delete(self, parameters: list[str]) -> None:
        buffer = self.named(single_parameter(parameters).split())
        name = next(known for known, kept in self._all.items() if kept is buffer)
        if name in (FIRST, SECOND):
            raise ScpiError(-224)
        del self._all[name]
        self._active = FIRST if self._active == name else self._active

    def _resize(self, parameters: list[str]) -> None:
        if not parameters:
            raise ScpiError(-109)
        buffer, size = self.named(parameters[1:]), whole_number(parameters[0], 0, MOST)
        if 0 < size < LEAST:
            raise ScpiError(-222)
        others = sum(kept.capacity for kept in self._all.values() if kept is not buffer)
        if others + size > MOST:
            raise ScpiError(-222)
        # 0 is the largest that there is room for.
        buffer.capacity = size or MOST - others
        buffer.clear()

    def _fill(self, parameters: list[str]) -> None:
        if not parameters:
            raise ScpiError(-109)
        buffer = self.named(parameters[1:])
        buffer.once = word("CONTinuous", "ONCE")(parameters[0]) == "ONCE"
        buffer.clear()

    def _data(self, parameters: list[str]) -> str:
        if len(parameters) < 2:
            raise ScpiError(-109)
        first, last = (whole_number(text, 1, 2**31) for text in parameters[:2])
        return self._written(self.named(parameters[2:3]), first, last, parameters[3:])

    def _written(self, buffer: Buffer, first: int, last: int, elements: list[str]) -> str:
        columns = [choice(element, words(*ELEMENTS)) for element in elements] or ["READ"]
        values, times_s, zero_s = buffer.part(first, last)
        if columns == ["READ"]:
            return readings_text(values)
        rows = zip(values.tolist(), times_s.tolist(), strict=True)
        return ",".join(
            self._element(column, value, at_s, zero_s) for value, at_s in rows for column in columns
        )

    def _element(self, column: str, value: float, at_s: float, zero_s: float) -> str:
        date = self._date(at_s)
        day, time = f"{date:%m/%d/%Y}", f"{date:%H:%M:%S}"
        return {
            "READ": f"{value:.6E}",
            "REL": f"{at_s - zero_s:.6f}",
            "SEC": str(int(date.timestamp())),
            "FRAC": f"{date.microsecond / 1e6:.6f}",
            "TIME": time,
            "DATE": day,
            "TST": f"{day} {time}.{date.microsecond:06d}000",
        }[column]


def readings_text(values: Array) -> str:
    """Return readings as the meter writes them."""
    return ",".join(f"{value:.6E}" for value in values.tolist())
