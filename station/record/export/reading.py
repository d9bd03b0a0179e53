"""What an export is made of: each unit of work of each source, block by block, with its columns.

The columns are described by the driver that recorded them: the unit, then what they mean. A count
of equal intervals says `every 0.1 s`; its time axis is computed from it here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from station.record.files import A_COPY, replaced
from station.record.raw import read_blocks
from station.record.raw_damage import raw_files, segment_of, source_of
from station.roles.base import ARRIVAL

if TYPE_CHECKING:
    from station.record.folder import RunFolder

TEXTS = {
    "plan": "plan.yaml",
    "plan_resolved": "plan.resolved.yaml",
    "bench": "bench.yaml",
    "bench_resolved": "bench.resolved.yaml",
    "run": "run.json",
    "results": "results.json",
}
"""Name in an export and file in the run folder."""

INTERVAL = re.compile(r"\bevery ([0-9.e+-]+) s\b")


@dataclass(frozen=True)
class Column:
    """A column of raw data: its name, its unit, and what it means."""

    name: str
    unit: str
    meaning: str

    @property
    def is_time(self) -> bool:
        """Whether it is a time axis in s."""
        return self.unit == "s" and self.name.endswith("time_s")


@dataclass
class CountedTime:
    """A time axis in s from a running number that counts equal intervals and may wrap around."""

    counter: str
    interval_s: float
    _last: int | None = None
    _counted: int = 0

    @property
    def column(self) -> Column:
        """The time axis as a column."""
        return Column(
            f"{self.counter}_time_s",
            "s",
            f"s by the instrument's own clock: {self.counter} times {self.interval_s:g} s, "
            "0 at the first row",
        )

    def times_s(self, rows: NDArray[Any]) -> NDArray[np.float64]:
        """Return the times in s of the next rows, shape (rows,)."""
        number = rows[self.counter]
        before = number[0] if self._last is None else self._last
        steps = np.diff(number.astype(np.int64), prepend=np.int64(before))
        if number.dtype.kind == "u" and number.dtype.itemsize < 8:
            steps = np.mod(steps, 2 ** (8 * number.dtype.itemsize))
        counted = self._counted + np.cumsum(steps)
        self._last, self._counted = int(number[-1]), int(counted[-1])
        return np.asarray(counted * self.interval_s, dtype=np.float64)


@dataclass
class RecordedSource:
    """One unit of work of one source: `columns` as recorded, and times counted from them."""

    source: str
    unit: str
    finished: bool
    recorded: tuple[Column, ...]
    counted: tuple[CountedTime, ...] = field(default=())

    @property
    def columns(self) -> tuple[Column, ...]:
        """All columns: as recorded, then the counted times."""
        return (*self.recorded, *(counter.column for counter in self.counted))

    @property
    def state(self) -> str:
        """`finished` or `unfinished`: whether the unit was measured to its end."""
        return "finished" if self.finished else "unfinished"

    @property
    def counters(self) -> set[str]:
        """Names of the columns that count intervals."""
        return {counter.counter for counter in self.counted}

    @property
    def axes(self) -> tuple[Column, ...]:
        """The time axes, the instrument's own before the time of arrival."""
        times = [column for column in self.columns if column.is_time]
        return tuple(sorted(times, key=lambda column: column.name == ARRIVAL))

    @property
    def signals(self) -> tuple[Column, ...]:
        """What was measured: neither a time nor a count of intervals."""
        return tuple(
            column
            for column in self.columns
            if not column.is_time and column.name not in self.counters
        )

    def arrays(self, rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Return the next rows by column name, each of shape (rows,); call it in their order."""
        given = {column.name: np.ascontiguousarray(rows[column.name]) for column in self.recorded}
        return {**given, **{counter.column.name: counter.times_s(rows) for counter in self.counted}}


def sources(folder: RunFolder) -> list[str]:
    """Return the sources that recorded anything, in order of name."""
    return sorted({source_of(path.name) for path in raw_files(folder.path)})


def blocks_of(folder: RunFolder, source: str) -> Iterator[tuple[RecordedSource, NDArray[Any]]]:
    """Yield the blocks of a source, each with the unit of work it belongs to, as recorded.

    Damaged blocks are passed over; a unit that the folder leaves out counts as unfinished. Of a
    unit that a resumed run measured again, only the segment that finished it is given.
    """
    finished = {event.details["unit"]: event.details for event in folder.events_of("unit-finished")}
    known: dict[str, RecordedSource] = {}
    for path in (file for file in raw_files(folder.path) if source_of(file.name) == source):
        for unit, described, rows in read_blocks(path):
            if unit in finished and int(finished[unit].get("segment", 0)) != segment_of(path.name):
                continue
            if unit not in known:
                whole = unit in finished and unit not in folder.left_out
                known[unit] = recording(source, unit, whole, described, rows)
            if len(rows):
                yield known[unit], rows


def recording(
    source: str, unit: str, finished: bool, described: Mapping[str, str], rows: NDArray[Any]
) -> RecordedSource:
    """Return what a unit of work of a source holds, as its driver described the columns."""
    names: Sequence[str] = rows.dtype.names or ()
    columns = tuple(
        Column(name, unit_of(described.get(name, "")), described.get(name, name)) for name in names
    )
    counted = tuple(
        CountedTime(column.name, float(match[1]))
        for column in columns
        if rows[column.name].dtype.kind in "ui" and (match := INTERVAL.search(column.meaning))
    )
    return RecordedSource(source, unit, finished, columns, counted)


def unit_of(meaning: str) -> str:
    """Return the unit that a column's description begins with; `1` where it has none."""
    return re.split(r"[\s,;:]", meaning.strip(), maxsplit=1)[0] or "1"


def texts_of(folder: RunFolder) -> dict[str, str]:
    """Return the texts that explain the data, by name; what the folder lacks is left out."""
    return {
        name: (folder.path / file).read_text(encoding="utf-8")
        for name, file in TEXTS.items()
        if (folder.path / file).is_file()
    }


def exported_file(path: Path) -> AbstractContextManager[Path]:
    """Return the context of a file that appears whole; raises RecordError (`replaced`)."""
    return replaced(path, A_COPY, parents=True)
