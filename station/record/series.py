"""What a run has recorded so far, thinned: each source's columns over run time, 600 points each."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.clock import boot_seconds
from station.record.files import is_own_file
from station.record.layout import RAW
from station.record.raw import ARRIVAL
from station.record.raw_tail import RawTail
from station.roles.role import role, role_of

Array = NDArray[np.float64]

MOST_POINTS = 600
COUNTED = "counts"
MOST_COLUMNS = 4
"""Of a source: the first ones, as the driver orders them."""
NO_QUANTITY = ("time_s", "state", "flags", "sequence", "number", "valid")


class Thinned:
    """A growing series of means, of as many values each as keeps it below `MOST_POINTS`."""

    def __init__(self) -> None:
        self.means = np.empty((0, 2))
        """Times in s and values, shape (points, 2)."""
        self._each = 1
        self._waiting = np.empty((0, 2))

    def add(self, time_s: Array, value: Array) -> None:
        """Add values at times, shape (n,) both; what is no number is left out."""
        rows = np.column_stack([time_s, value])
        rows = np.concatenate([self._waiting, rows[np.isfinite(rows).all(axis=1)]])
        while True:
            whole = len(rows) // self._each * self._each
            means = rows[:whole].reshape(-1, self._each, 2).mean(axis=1)
            if len(self.means) + len(means) < MOST_POINTS:
                break
            even = len(self.means) // 2 * 2
            odd = np.repeat(self.means[even:], self._each, axis=0)
            self.means = self.means[:even].reshape(-1, 2, 2).mean(axis=1)
            self._each, rows = 2 * self._each, np.concatenate([odd, rows])
        self.means, self._waiting = np.concatenate([self.means, means]), rows[whole:]

    def data(self, *, rate: bool = False) -> dict[str, list[float]]:
        """Return times in s and values, or what the values change by in a second."""
        times, values = self.means.T
        if rate:
            # What arrived together has one time: its last count is that of the time.
            last = np.append(np.diff(times) > 0.0, True)[: len(times)]
            times, values = times[last], values[last]
            times, values = (times[1:] + times[:-1]) / 2.0, np.diff(values) / np.diff(times)
        return {"t": times.round(3).tolist(), "v": [float(f"{value:.7g}") for value in values]}


class RunSeries:
    """The series of a run, by source and column, for whoever watches it."""

    def __init__(self, folder: Path) -> None:
        self._raw = folder / RAW
        self._tails: dict[Path, RawTail] = {}
        self._series: dict[str, dict[str, Thinned]] = {}

    def look(self, within_s: float = math.inf) -> bool:
        """Read what was added, for so long in real time at most; whether there was anything.

        What there was no time for is read at the next look.
        """
        until_s, added = boot_seconds() + within_s, False
        for path in sorted(self._raw.rglob("*.mcap")) if self._raw.is_dir() else ():
            if not is_own_file(path):
                continue
            tail = self._tails.setdefault(path, RawTail(path))
            series = self._series.setdefault(source_of(path), {})
            for _, rows in tail.new_rows():
                added = True
                for name in columns_of(rows):
                    series.setdefault(name, Thinned()).add(rows[ARRIVAL], rows[name])
                if boot_seconds() > until_s:
                    return added
        return added

    def data(self) -> dict[str, Any]:
        """Return the series as plain data: plot, by source and unit, to line to times and values.

        Of what an instrument counts, the pulses in a second are shown.
        """
        plots: dict[str, dict[str, dict[str, list[float]]]] = {}
        for source, series in self._series.items():
            for name, thinned in series.items():
                plots.setdefault(f"{source}, {unit_of(name)}", {})[name] = values_of(name, thinned)
        return plots

    def of_device(self) -> Trace | None:
        """Return what the device under test gave, None where nothing of it was recorded yet."""
        for source, series in self._series.items():
            declared = role(role_of(source))
            if declared is None or not declared.reads_device:
                continue
            for name, thinned in series.items():
                if values := values_of(name, thinned)["v"]:
                    return Trace(source, name.rpartition("_")[0] or name, unit_of(name), values)
        return None


class Trace(NamedTuple):
    """Values of one quantity of a source, in the order of time."""

    source: str
    quantity: str
    unit: str
    values: list[float]


def unit_of(column: str) -> str:
    """Return the unit in which a column is shown."""
    return "counts/s" if column == COUNTED else column.rpartition("_")[2]


def values_of(column: str, series: Thinned) -> dict[str, list[float]]:
    """Return times in s and values of a column as it is shown."""
    return series.data(rate=column == COUNTED)


def source_of(path: Path) -> str:
    """Return the instrument whose rows a raw file holds."""
    return path.stem.rpartition("-")[0]


def columns_of(rows: Any) -> list[str]:
    """Return the columns that are quantities."""
    names = [
        name
        for name in rows.dtype.names
        if rows.dtype[name].kind in "fiu"
        and not rows.dtype[name].shape
        and not name.endswith(NO_QUANTITY)
    ]
    return names[:MOST_COLUMNS]
