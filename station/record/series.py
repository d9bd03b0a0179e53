"""What a run has recorded so far, thinned: each source's columns over run time, 600 points each.

Of so many rows the least and the greatest value are kept, each at its time: what swings, or was
there for a moment, is shown as large as it was.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.clock import boot_seconds
from station.record.careful_reading import own_text
from station.record.files import is_own_file
from station.record.layout import PLAN, RAW
from station.record.raw_tail import RawTail
from station.roles.base import ARRIVAL
from station.roles.role import role, role_of
from station.units import UnitError, parse_as, shown_in

Array = NDArray[np.float64]

MAX_POINTS = 600
COUNTED = "counts"
MUCH_OF_A_GAP = 0.8
PULSE_WEIGHT = re.compile(r"^ +pulse_weight: (.*?) *(?:#.*)?$", re.MULTILINE)
"""What a count of the device is worth, in the resolved plan of a procedure that knows it."""
MAX_COLUMNS = 4
"""Of a source: the first ones, as the driver orders them."""
NO_QUANTITY = ("time_s", "state", "flags", "sequence", "counter", "number", "valid")


class Thinned:
    """A growing series of the extremes of as many rows each as keeps it below `MAX_POINTS`.

    `counted` values only grow: the last of so many stands for them, since what is shown is their
    change. `mean` is that of all values.
    """

    def __init__(self, *, counted: bool = False) -> None:
        self._counted = counted
        self._each = 1
        self._groups = np.empty((0, 1 if counted else 2, 2))
        """Of each group of rows its points, times in s and values."""
        self._waiting = np.empty((0, 2))
        self._sum, self._count = 0.0, 0

    def add(self, time_s: Array, value: Array) -> None:
        """Add values at times, shape (n,) both; what is no number is left out."""
        rows = np.column_stack([time_s, value])
        rows = rows[np.isfinite(rows).all(axis=1)]
        self._sum, self._count = self._sum + float(rows[:, 1].sum()), self._count + len(rows)
        rows = np.concatenate([self._waiting, rows])
        per_group = self._groups.shape[1]
        while True:
            whole = len(rows) // self._each * self._each
            groups = self._kept(rows[:whole].reshape(-1, self._each, 2))
            if (len(self._groups) + len(groups)) * per_group < MAX_POINTS:
                break
            even = len(self._groups) // 2 * 2
            odd = np.repeat(self._groups[even:].reshape(-1, 2), self._each, axis=0)[: self._each]
            self._groups = self._kept(self._groups[:even].reshape(even // 2, 2 * per_group, 2))
            self._each, rows = 2 * self._each, np.concatenate([odd, rows])
        self._groups = np.concatenate([self._groups, groups])
        self._waiting = rows[whole:]

    @property
    def mean(self) -> float:
        """The mean of all values; NaN where there is none."""
        return self._sum / self._count if self._count else math.nan

    def data(self, *, factor: float = 1.0) -> dict[str, list[float]]:
        """Return times in s and values, those of counts as what they change by in a second."""
        points = self._groups.reshape(-1, 2)
        if self._counted:
            points = points[_apart(points[:, 0])]
            times = (points[1:, 0] + points[:-1, 0]) / 2.0
            values = np.diff(points[:, 1]) / np.diff(points[:, 0])
        else:
            # A group of one row, or of equal ones, has its point twice.
            again = (np.diff(points, axis=0) == 0.0).all(axis=1)
            points = points[np.append(True, ~again)[: len(points)]]
            times, values = points.T
        return {"t": times.round(3).tolist(), "v": [float(f"{v:.7g}") for v in values * factor]}

    def _kept(self, groups: Array) -> Array:
        """Return the points that stand for groups of rows, shape (groups, rows, 2)."""
        if self._counted:
            return groups[:, -1:]
        value = groups[:, :, 1]
        if not value.size:
            return np.empty((len(groups), 2, 2))
        chosen = np.sort(np.stack([value.argmin(axis=1), value.argmax(axis=1)], axis=1), axis=1)
        return np.take_along_axis(groups, chosen[:, :, None], axis=1)


def _apart(time_s: Array) -> list[int]:
    """Return which counts stand apart in time, by index.

    Outputs that came in one go have nearly one time, and the change between two of them says
    nothing: a gap that is short beside the usual one is joined to the next, and the last count of
    what came together is that of its time.
    """
    gaps_s = np.diff(time_s)
    least_s = MUCH_OF_A_GAP * float(np.quantile(gaps_s[gaps_s > 0.0], 0.9)) if gaps_s.any() else 0.0
    kept: list[int] = []
    for index in range(len(time_s) - 1, -1, -1):
        if not kept or time_s[kept[-1]] - time_s[index] > least_s:
            kept.append(index)
    return kept[::-1]


class RunSeries:
    """The series of a run, by source and column, for whoever watches it."""

    def __init__(self, folder: Path, chosen: Callable[[str], bool] | None = None) -> None:
        """Read a run folder: the first columns of each source, or all that are `chosen`."""
        self._chosen = chosen
        self._raw = folder / RAW
        self._pulse_weight_arcsec = pulse_weight_arcsec(folder)
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
                for name in columns_of(rows, self._chosen):
                    if name not in series:
                        series[name] = Thinned(counted=name == COUNTED)
                    series[name].add(rows[ARRIVAL], rows[name])
                if boot_seconds() > until_s:
                    return added
        return added

    def data(self) -> list[dict[str, Any]]:
        """Return the series as plain data, those of the device under test first.

        Each is of one source and unit: `columns` has times and values by column, `device` says
        whether the source reads the device. Of what an instrument counts, the rate is shown where
        the plan says what a pulse weighs, else the pulses in a second.
        """
        plots: dict[tuple[str, str], dict[str, Any]] = {}
        for source, series in self._series.items():
            for name, thinned in series.items():
                quantity, unit, factor = self._shown(name)
                plot = plots.setdefault(
                    (source, unit),
                    {"source": source, "unit": unit, "device": is_of_device(source), "columns": {}},
                )
                column = f"{quantity}_{unit}" if quantity else name
                plot["columns"][column] = thinned.data(factor=factor)
        return sorted(plots.values(), key=lambda plot: not plot["device"])

    def ranges(self) -> Iterator[tuple[str, str, tuple[float, float, float]]]:
        """Yield source, column, and the least, the mean and the greatest value of each series."""
        for source, series in self._series.items():
            for name, thinned in series.items():
                if values := thinned.data()["v"]:
                    yield source, name, (min(values), thinned.mean, max(values))

    def of_device(self) -> Trace | None:
        """Return what the device under test gave, None where nothing of it was recorded yet."""
        for source, series in self._series.items():
            if not is_of_device(source):
                continue
            for name, thinned in series.items():
                quantity, unit, factor = self._shown(name)
                if values := thinned.data(factor=factor)["v"]:
                    return Trace(source, quantity or name, unit, values)
        return None

    def _shown(self, column: str) -> tuple[str, str, float]:
        """Return quantity and unit in which a column is shown, and what its values are times."""
        if column == COUNTED:  # an arc second in a second is a degree in an hour
            weight = self._pulse_weight_arcsec
            return ("", "counts/s", 1.0) if weight is None else ("rate", "deg/h", weight)
        quantity, _, unit = column.rpartition("_")
        return (quantity, *shown_in(unit))


class Trace(NamedTuple):
    """Values of one quantity of a source, in the order of time."""

    source: str
    quantity: str
    unit: str
    values: list[float]


def pulse_weight_arcsec(folder: Path) -> float | None:
    """Return what a pulse of the device weighs by the plan of a run, in arcsec; None unstated."""
    stated = PULSE_WEIGHT.search(own_text(folder / PLAN))
    try:
        return parse_as(stated[1], "arcsec") if stated else None
    except UnitError:
        return None


def is_of_device(source: str) -> bool:
    """Return whether an instrument reads the device under test."""
    declared = role(role_of(source))
    return declared is not None and declared.reads_device


def source_of(path: Path) -> str:
    """Return the instrument whose rows a raw file holds."""
    return path.stem.rpartition("-")[0]


def columns_of(rows: Any, chosen: Callable[[str], bool] | None = None) -> list[str]:
    """Return the columns that are quantities: the first of them, or all that are chosen."""
    names = [
        name
        for name in rows.dtype.names
        if rows.dtype[name].kind in "fiu"
        and not rows.dtype[name].shape
        and not name.endswith(NO_QUANTITY)
    ]
    return names[:MAX_COLUMNS] if chosen is None else [name for name in names if chosen(name)]
