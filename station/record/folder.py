"""The run folder: one execution of a plan and everything it left behind."""

from __future__ import annotations

import json
import re
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from datetime import date, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from station.clock import Clock, utc_now
from station.console import tell
from station.errors import DamagedRecord, InputError, MissingRows, RecordError
from station.files.locks import is_held
from station.files.lookup import is_there
from station.record.events import Event, EventLog, guardian_events, read_events
from station.record.files import json_text, write_whole_file
from station.record.later import seal
from station.record.layout import (
    EVENTS,
    LOCK,
    RAW,
    RUN,
    Presence,
    folder_with_head,
    next_segment,
    raw_file,
    run_lock,
)
from station.record.run_names import STAMP_FORM
from station.record.run_state import RunState

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.record.integrity import FolderState
    from station.record.raw import RawFile, RawIndex

RESULTS = "results.json"
REPORT = "report.html"
PLOTS = "plots.json"
MAX_LATER = 1000
FACTS = ("started_utc", "station", "python", "packages", "host", "system")
PIECE_ROWS = 2**19
"""Rows that are read at once; what is longer is read in pieces."""

Kept = TypeVar("Kept")


class RunRecord:
    """The folder of a run while it is written.

    Its calls raise RecordError where the disk does not take what they write; `note`, `close` and
    `seal` say so on standard error and go on, for a bench that is being made safe.
    """

    def __init__(
        self,
        parent: Path,
        procedure: str,
        serial: str,
        clock: Clock,
        head: Mapping[str, str | bytes] | None = None,
    ) -> None:
        stamp = utc_now().strftime(STAMP_FORM)
        safe_serial = re.sub(r"[^A-Za-z0-9._-]+", "_", serial)
        name = f"{stamp}-{procedure}-{safe_serial}"
        self._open(folder_with_head(parent, name, head or {}), clock)

    @classmethod
    def go_on(cls, path: Path, clock: Clock) -> RunRecord:
        """Open the folder of a run that ended before its end, to write new segments into it.

        Raises RecordError where a process is at work on it, or its log was altered.
        """
        record = cls.__new__(cls)
        record._open(path, clock)
        return record

    def _open(self, path: Path, clock: Clock) -> None:
        self.path = path
        self.faults: list[str] = []
        """What could not be written while the bench was being made safe, and after."""
        self._later: deque[tuple[float, str, dict[str, Any]]] = deque(maxlen=MAX_LATER)
        self.after_unit: list[Callable[[str], None]] = []
        """What is called with the name of each unit of work when it is finished."""
        self._clock = clock
        self._lock = run_lock(self.path)
        self.presence = Presence(path)
        self._events = EventLog(self.path / EVENTS)
        self._raw: dict[str, RawFile] = {}
        self.segment = next_segment(path / RAW)
        """The number of this process's raw files; no process writes one of another."""

    def event(self, kind: str, *, durable: bool = True, **details: Any) -> None:
        """Append an event at the present run time.

        It survives the death of the process at once; `durable` waits until the disk has it too.
        """
        if durable:
            self.presence.check()
        self.write_later()
        self._events.append(self._clock.now(), kind, details, durable=durable)
        # A disk that stood still may have kept the thread from hearing that the run is to end.
        self._clock.raise_interruption()

    def later(self, kind: str, **details: Any) -> None:
        """Keep an event of this moment, from any thread, until the run's own writes it."""
        self._later.append((self._clock.now(), kind, details))

    def write_later(self) -> None:
        """Append the events that other threads have kept."""
        while self._later:
            time_s, kind, details = self._later.popleft()
            now_s = self._clock.now()
            self._events.append(now_s, kind, {"at_s": round(time_s, 3), **details}, durable=False)

    def note(self, kind: str, **details: Any) -> None:
        """Append an event, or say on standard error that it could not be written."""
        self.note_at(self._clock.now(), kind, **details)

    def note_at(self, time_s: float, kind: str, **details: Any) -> None:
        """As `note`, of something that was at run time `time_s`."""
        self._try(lambda: self._events.append(time_s, kind, details, durable=True))

    def write_text(self, name: str, text: str) -> None:
        """Write a text file of the folder, whole and on disk, or not at all."""
        write_whole_file(self.path / name, text.encode())

    def write_json(self, name: str, data: Mapping[str, Any]) -> None:
        """Write a JSON file of the folder; numbers must be finite."""
        self.write_text(name, json_text(data))

    def block(self, source: str, unit: str, columns: Mapping[str, str], rows: NDArray[Any]) -> None:
        """Append a block of raw rows of `source` that belongs to `unit`."""
        self.presence.check()
        if source not in self._raw:
            from station.record.raw import RawFile

            self._raw[source] = RawFile(raw_file(self.path, source, self.segment), source, columns)
        self._raw[source].write(unit, rows)

    def finish_unit(self, unit: str, **details: Any) -> None:
        """Bring a unit's raw data to disk, then say that it is finished."""
        for file in self._raw.values():
            file.sync()
        sizes = {source: file.size for source, file in self._raw.items()}
        self.event("unit-finished", unit=unit, segment=self.segment, raw_bytes=sizes, **details)
        for notify in self.after_unit:
            notify(unit)

    def close(self) -> None:
        """Close the raw files and the log."""
        for file in self._raw.values():
            self._try(file.close)
        self._raw.clear()
        self._try(self._events.close)

    def seal(self) -> None:
        """Log which revisions there are, and write the manifest.

        What is done with the folder afterwards is recorded by `station.record.later`.
        """
        self._try(lambda: seal(self.path))
        self._lock.release()

    def _try(self, write: Callable[[], None]) -> None:
        try:
            write()
        except (RecordError, OSError) as error:
            self.faults.append(str(error))
            tell(f"not recorded: {error}")


class RunFolder:
    """The folder of a run as it is read back, by analysis, report and status.

    A resumed run may have begun a unit in one segment and finished it in a later one: only rows
    of the segment that finished it count. `segment` is that of the process which reads what it
    has just written of a unit that is not finished yet.
    """

    def __init__(self, path: Path, segment: int | None = None) -> None:
        if not (path / EVENTS).is_file():
            raise RecordError(f"{path} is no run folder: it holds no {EVENTS}")
        self.path = path
        self._held = is_held(path / LOCK)  # first: a run that ends meanwhile has logged that
        self._segment = segment
        self.events: tuple[Event, ...] = tuple(read_events(path / EVENTS))
        self._rows: dict[tuple[str, str], NDArray[Any]] = {}
        self._indices: dict[Path, RawIndex] = {}
        self._kept: dict[Hashable, Any] = {}
        self.left_out: frozenset[str] = frozenset()
        """Finished units of work that count as not measured, since their data are damaged."""

    @cached_property
    def damage(self) -> FolderState:
        """What of the folder is not any more what the run wrote; looked for when first asked."""
        from station.record.integrity import state_of

        return state_of(self, whole=True)

    @cached_property
    def state(self) -> RunState:
        """What the run did, and how it left its bench, by its log and its guardian's."""
        return RunState(self.events, guardian_events(self.path))

    @property
    def goes_on(self) -> bool:
        """Whether the run's process was at its steps still when the log was read."""
        return self.state.state(held=self._held) in ("running", "paused")

    def finished_units(self) -> dict[str, dict[str, Any]]:
        """Return the details of each finished unit of work, in the order they were finished.

        Those that are left out are not among them.
        """
        units = self.state.units.items()
        return {unit: details for unit, details in units if unit not in self.left_out}

    def leave_out(self, units: Iterable[str]) -> None:
        """Have finished units of work count as not measured."""
        self.left_out |= frozenset(units)

    def run_facts(self) -> dict[str, Any]:
        """Return run.json: what differs from one execution to the next.

        Raises DamagedRecord where it does not say what every run says.
        """
        if not (self.path / RUN).is_file():
            raise DamagedRecord(f"{self.path / RUN} is missing, or is no file")
        try:
            facts: dict[str, Any] = json.loads((self.path / RUN).read_text(encoding="utf-8"))
            datetime.fromisoformat(facts["started_utc"])
            lacks = [key for key in FACTS if key not in facts]
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            lacks = ["started_utc"]
        if lacks:
            raise DamagedRecord(f"{self.path / RUN} was altered: it does not say {lacks[0]}")
        return facts

    def index(self, file: Path) -> RawIndex:
        """Return where the blocks of a raw file stand; the file is gone through once."""
        from station.record.raw import RawIndex

        if file not in self._indices:
            self._indices[file] = RawIndex(file)
        return self._indices[file]

    @property
    def last_day(self) -> date:
        """The day, in UTC, of the last that the run did."""
        began = datetime.fromisoformat(self.run_facts()["started_utc"])
        return (began + timedelta(seconds=self.events[-1].time_s)).date()

    def events_of(self, kind: str) -> Iterator[Event]:
        """Yield the events of one kind."""
        return (event for event in self.events if event.kind == kind)

    def rows(self, source: str, unit: str) -> NDArray[Any]:
        """Return a unit's raw rows of one source as a structured array, shape (rows,).

        Raises MissingRows when there are none.
        """
        import numpy as np

        pieces = list(self.pieces(source, unit))
        if len(pieces) > 1:
            self._rows[source, unit] = np.concatenate(pieces)
        return self._rows[source, unit]

    def pieces(self, source: str, unit: str) -> Iterator[NDArray[Any]]:
        """Yield a unit's raw rows of one source in their order, some `PIECE_ROWS` at a time.

        What is one piece is kept for who asks again; of a longer record nothing is. Raises
        MissingRows when there are no rows.
        """
        if (source, unit) in self._rows:
            yield self._rows[source, unit]
            return
        from station.record.raw import joined

        pieces = joined(self._blocks_of(source, unit), PIECE_ROWS)
        first, more = next(pieces), next(pieces, None)
        if more is None:
            self._rows[source, unit] = first
        yield first
        del first
        if more is not None:
            yield more
            yield from pieces

    def once(self, name: Hashable, find: Callable[[], Kept]) -> Kept:
        """Return what `find` found when it was asked for by this name for the first time."""
        if name not in self._kept:
            self._kept[name] = find()
        kept: Kept = self._kept[name]
        return kept

    def recorded_blocks(self, source: str, unit: str, every: int = 1) -> list[NDArray[Any]]:
        """Return what all processes of the run recorded of a unit, one in `every` blocks."""
        indices = (self._index(source, segment) for segment in range(next_segment(self.path / RAW)))
        return [block for index in indices if index for block in index.blocks(unit, every)]

    def _blocks_of(self, source: str, unit: str) -> Iterator[NDArray[Any]]:
        for segment in self._segments_of(unit):
            index = self._index(source, segment)
            if index is not None and unit in index:
                return index.blocks(unit)
        raise MissingRows(unit, f"no raw data of {source} are in {self.path / RAW}")

    def _index(self, source: str, segment: int) -> RawIndex | None:
        file = raw_file(self.path, source, segment)
        return self.index(file) if file.is_file() else None

    def _segments_of(self, unit: str) -> list[int]:
        """Return where to look for a unit's rows: this process's own, then where it was finished.

        A unit that was never finished is looked for from the newest segment on.
        """
        finished = self.finished_units().get(unit)
        own = [] if self._segment is None else [self._segment]
        if finished is not None:
            return [*own, int(finished.get("segment", 0))]
        return [*own, *reversed(range(next_segment(self.path / RAW)))]


def read_run(path: Path) -> RunFolder:
    """Return the run folder that a person named; raises InputError where it is none."""
    if not is_there(path / EVENTS):
        raise InputError(f"{path} is no run folder: it holds no {EVENTS}")
    return RunFolder(path)
