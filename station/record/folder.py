"""The run folder: one execution of a plan and everything it left behind."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.clock import Clock, utc_now
from station.console import tell
from station.errors import RecordError
from station.locks import FileLock
from station.record.creation import EVENTS, RAW, folder_with_head
from station.record.events import Event, EventLog, read_events
from station.record.files import write_whole_file
from station.record.manifest import LOCK, write_manifest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.record.raw import RawFile, RawIndex

RUN = "run.json"
RESULTS = "results.json"
REPORT = "report.html"
EXPORTS = "exports"
RESUMED = "resumed"


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
        stamp = utc_now().strftime("%Y%m%dT%H%M%SZ")
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
        self.after_unit: list[Callable[[str], None]] = []
        """What is told the name of each unit of work when it is finished."""
        self._clock = clock
        self._lock = run_lock(self.path)
        facts = path.stat()
        self._identity = facts.st_dev, facts.st_ino
        self._events = EventLog(self.path / EVENTS)
        self._raw: dict[str, RawFile] = {}
        self.segment = next_segment(path / RAW)
        """The number of this process's raw files; no process writes one of another."""

    def event(self, kind: str, *, durable: bool = True, **details: Any) -> None:
        """Append an event at the present run time.

        It survives the death of the process at once; `durable` waits until the disk has it too.
        """
        self.must_be_there()
        self._events.append(self._clock.now(), kind, details, durable=durable)
        # A disk that stood still may have kept the thread from hearing that the run is to end.
        self._clock.raise_interruption()

    def note(self, kind: str, **details: Any) -> None:
        """Append an event, or say on standard error that it could not be written."""
        self.note_at(self._clock.now(), kind, **details)

    def note_at(self, time_s: float, kind: str, **details: Any) -> None:
        """As `note`, of something that was at run time `time_s`."""
        self._try(lambda: self._events.append(time_s, kind, details, durable=True))

    def must_be_there(self) -> None:
        """Raise RecordError where the folder is no longer at its place."""
        if not self.is_there():
            raise RecordError(
                f"the run folder {self.path} was removed, moved or unmounted while the run went "
                "on; what was recorded is in it, wherever it is now"
            )

    def is_there(self) -> bool:
        """Whether the folder that this run writes is the one at its place."""
        try:
            facts = self.path.stat()
        except OSError:
            return False
        return (facts.st_dev, facts.st_ino) == self._identity

    def write_text(self, name: str, text: str) -> None:
        """Write a text file of the folder, whole and on disk, or not at all."""
        write_whole_file(self.path / name, text.encode())

    def write_json(self, name: str, data: Mapping[str, Any]) -> None:
        """Write a JSON file of the folder; numbers must be finite."""
        self.write_text(name, json_text(data))

    def block(self, source: str, unit: str, columns: Mapping[str, str], rows: NDArray[Any]) -> None:
        """Append a block of raw rows of `source` that belongs to `unit`."""
        self.must_be_there()
        if source not in self._raw:
            from station.record.raw import RawFile

            self._raw[source] = RawFile(raw_file(self.path, source, self.segment), source, columns)
        self._raw[source].write(unit, rows)

    def finish_unit(self, unit: str, **details: Any) -> None:
        """Bring a unit's raw data to disk, then say that it is finished."""
        for file in self._raw.values():
            file.sync()
        self.event("unit-finished", unit=unit, segment=self.segment, **details)
        for told in self.after_unit:
            told(unit)

    def close(self) -> None:
        """Close the raw files and the log."""
        for file in self._raw.values():
            self._try(file.close)
        self._raw.clear()
        self._try(self._events.close)

    def seal(self) -> None:
        """Write the manifest; nothing of the folder changes after it."""
        self._try(lambda: write_manifest(self.path))
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
        self._segment = segment
        self.events: tuple[Event, ...] = tuple(read_events(path / EVENTS))
        self._rows: dict[tuple[str, str], NDArray[Any]] = {}
        self._indices: dict[Path, RawIndex] = {}

    def finished_units(self) -> dict[str, dict[str, Any]]:
        """Return the details of each finished unit of work, in the order they were finished."""
        return {
            event.details["unit"]: event.details
            for event in self.events
            if event.kind == "unit-finished"
        }

    def run_facts(self) -> dict[str, Any]:
        """Return run.json: what differs from one execution to the next."""
        facts: dict[str, Any] = json.loads((self.path / RUN).read_text(encoding="utf-8"))
        return facts

    def events_of(self, kind: str) -> Iterator[Event]:
        """Yield the events of one kind."""
        return (event for event in self.events if event.kind == kind)

    def of_last_process(self, kind: str) -> list[Event]:
        """Return the events of one kind since the run was begun, or last gone on with."""
        since = max((k for k, one in enumerate(self.events) if one.kind == RESUMED), default=0)
        return [event for event in self.events[since:] if event.kind == kind]

    def rows(self, source: str, unit: str) -> NDArray[Any]:
        """Return a unit's raw rows of one source as a structured array, shape (rows,).

        Raises RecordError when there are none.
        """
        import numpy as np

        if (source, unit) not in self._rows:
            blocks: list[NDArray[Any]] = []
            for segment in self._segments_of(unit):
                blocks = self._blocks(source, unit, segment)
                if blocks:
                    break
            if not blocks:
                raise RecordError(f"{self.path}: no raw data of {source} for {unit}")
            self._rows[source, unit] = np.concatenate(blocks)
        return self._rows[source, unit]

    def course(self, source: str, unit: str, every: int = 1) -> list[NDArray[Any]]:
        """Return what all processes of the run recorded of a unit, every so-manieth block."""
        segments = range(next_segment(self.path / RAW))
        return [block for one in segments for block in self._blocks(source, unit, one, every)]

    def _blocks(self, source: str, unit: str, segment: int, every: int = 1) -> list[NDArray[Any]]:
        from station.record.raw import RawIndex

        file = raw_file(self.path, source, segment)
        if file not in self._indices and file.is_file():
            self._indices[file] = RawIndex(file)
        index = self._indices.get(file)
        return list(index.blocks(unit, every)) if index else []

    def _segments_of(self, unit: str) -> list[int]:
        """Return where to look for a unit's rows: this process's own, then where it was finished.

        A unit that was never finished is looked for from the newest segment on.
        """
        finished = self.finished_units().get(unit)
        own = [] if self._segment is None else [self._segment]
        if finished is not None:
            return [*own, int(finished.get("segment", 0))]
        return [*own, *reversed(range(next_segment(self.path / RAW)))]

    def new_revision(self) -> Path:
        """Return a fresh folder for a re-analysis; earlier ones stay as they are."""
        parent = self.path / "revisions"
        parent.mkdir(exist_ok=True)
        number = len([path for path in parent.iterdir() if path.is_dir()])
        revision = parent / f"{number:03d}"
        revision.mkdir()
        return revision


def raw_file(folder: Path, source: str, segment: int) -> Path:
    """Return the raw file of a source that one process of a run writes."""
    return folder / RAW / f"{source}-{segment:03d}.mcap"


def next_segment(raw: Path) -> int:
    """Return the number after those of the raw files that are there, 0 where there are none."""
    numbers = [int(path.stem.rpartition("-")[2]) for path in raw.glob("*-[0-9][0-9][0-9].mcap")]
    return max(numbers, default=-1) + 1


def run_lock(folder: Path) -> FileLock:
    """Take the lock that says that a process is at work on a run; raises RecordError."""
    try:
        return FileLock(folder / LOCK)
    except OSError as error:
        raise RecordError(
            f"cannot lock {folder / LOCK}: {error.strerror or error}; choose another place, on a "
            "local disk, with --output"
        ) from error


def json_text(data: Mapping[str, Any]) -> str:
    """Return data as the text of a JSON file; numbers must be finite."""
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
