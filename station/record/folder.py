"""The run folder: one execution of a plan and everything it left behind."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.clock import Clock, utc_now
from station.errors import RecordError
from station.locks import FileLock
from station.record.events import Event, EventLog, read_events
from station.record.files import sync_folder, write_whole_file
from station.record.manifest import LOCK, write_manifest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.record.raw import RawFile

EVENTS = "events.jsonl"
RUN = "run.json"
RESULTS = "results.json"
REPORT = "report.html"
EXPORTS = "exports"
MOST_OF_ONE_NAME = 1000


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
        head: Mapping[str, str] | None = None,
    ) -> None:
        stamp = utc_now().strftime("%Y%m%dT%H%M%SZ")
        safe_serial = re.sub(r"[^A-Za-z0-9._-]+", "_", serial)
        self.path = folder_with_head(parent, f"{stamp}-{procedure}-{safe_serial}", head or {})
        self.faults: list[str] = []
        """What could not be written while the bench was being made safe, and after."""
        self.after_unit: Callable[[], None] | None = None
        """What is looked at whenever a unit of work is finished."""
        self._clock = clock
        self._lock = run_lock(self.path)
        self._events = EventLog(self.path / EVENTS)
        self._raw: dict[str, RawFile] = {}

    def event(self, kind: str, *, durable: bool = True, **details: Any) -> None:
        """Append an event at the present run time.

        It survives the death of the process at once; `durable` waits until the disk has it too.
        """
        self._events.append(self._clock.now(), kind, details, durable=durable)

    def note(self, kind: str, **details: Any) -> None:
        """Append an event, or say on standard error that it could not be written."""
        self._try(lambda: self.event(kind, **details))

    def write_text(self, name: str, text: str) -> None:
        """Write a text file of the folder, whole and on disk, or not at all."""
        write_whole_file(self.path / name, text.encode())

    def write_json(self, name: str, data: Mapping[str, Any]) -> None:
        """Write a JSON file of the folder; numbers must be finite."""
        self.write_text(name, json_text(data))

    def block(self, source: str, unit: str, columns: Mapping[str, str], rows: NDArray[Any]) -> None:
        """Append a block of raw rows of `source` that belongs to `unit`."""
        if source not in self._raw:
            from station.record.raw import RawFile

            path = self.path / "raw" / f"{source}-000.mcap"
            self._raw[source] = RawFile(path, source, columns)
        self._raw[source].write(unit, rows)

    def finish_unit(self, unit: str, **details: Any) -> None:
        """Bring a unit's raw data to disk, then say that it is finished."""
        for file in self._raw.values():
            file.sync()
        self.event("unit-finished", unit=unit, **details)
        if self.after_unit is not None:
            self.after_unit()

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
            print(f"not recorded: {error}", file=sys.stderr)


class RunFolder:
    """The folder of a run as it is read back, by analysis, report and status."""

    def __init__(self, path: Path) -> None:
        if not (path / EVENTS).is_file():
            raise RecordError(f"{path} is no run folder: it holds no {EVENTS}")
        self.path = path
        self.events: tuple[Event, ...] = tuple(read_events(path / EVENTS))
        self._rows: dict[tuple[str, str], NDArray[Any]] = {}

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

    def rows(self, source: str, unit: str) -> NDArray[Any]:
        """Return a unit's raw rows of one source as a structured array, shape (rows,).

        Raises RecordError when there are none.
        """
        import numpy as np

        from station.record.raw import read_raw

        if (source, unit) not in self._rows:
            files = sorted((self.path / "raw").glob(f"{source}-*.mcap"))
            blocks = [block for file in files for block in read_raw(file, unit)]
            if not blocks:
                raise RecordError(f"{self.path}: no raw data of {source} for {unit}")
            self._rows[source, unit] = np.concatenate(blocks)
        return self._rows[source, unit]

    def new_revision(self) -> Path:
        """Return a fresh folder for a re-analysis; earlier ones stay as they are."""
        parent = self.path / "revisions"
        parent.mkdir(exist_ok=True)
        number = len([path for path in parent.iterdir() if path.is_dir()])
        revision = parent / f"{number:03d}"
        revision.mkdir()
        return revision


def run_lock(folder: Path) -> FileLock:
    """Take the lock that says that a process is at work on a run; raises RecordError."""
    try:
        return FileLock(folder / LOCK)
    except OSError as error:
        raise RecordError(
            f"cannot lock {folder / LOCK}: {error.strerror or error}; choose another place, on a "
            "local disk, with --output"
        ) from error


def new_folder(parent: Path, name: str) -> Path:
    """Create and return `parent/name`, or `name-2`, `name-3` where that exists already.

    Raises RecordError when the parent cannot be written.
    """
    for number in range(1, MOST_OF_ONE_NAME):
        path = parent / numbered(name, number)
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordError(
                f"cannot create the run folder {path}: {error.strerror}; "
                "choose another place with --output"
            ) from error
        return path
    raise RecordError(f"{parent} holds a thousand runs of this second; choose another --output")


def folder_with_head(parent: Path, name: str, head: Mapping[str, str]) -> Path:
    """Create `parent/name` that holds `head` (texts by file name) from its first moment on.

    It is built beside its place, under a name that begins with a dot, and then moved there: a run
    that was killed at its very beginning leaves no folder that does not open.
    """
    being_built = new_folder(parent, f".new-{name}")
    try:
        (being_built / "raw").mkdir()
        for file, text in {**head, EVENTS: ""}.items():
            write_whole_file(being_built / file, text.encode())
        place = moved(being_built, parent, name)
        sync_folder(parent)
    except BaseException:
        shutil.rmtree(being_built, ignore_errors=True)
        raise
    return place


def moved(folder: Path, parent: Path, name: str) -> Path:
    """Move a folder to the first free one of `parent/name`, `name-2`, `name-3`."""
    for number in range(1, MOST_OF_ONE_NAME):
        place = parent / numbered(name, number)
        if place.exists():
            continue
        try:
            folder.rename(place)
        except OSError:
            if place.exists():  # another run was faster
                continue
            raise
        return place
    raise RecordError(f"{parent} holds a thousand runs of this second; choose another --output")


def numbered(name: str, number: int) -> str:
    """Return `name`, `name-2`, `name-3` …"""
    return name if number == 1 else f"{name}-{number}"


def json_text(data: Mapping[str, Any]) -> str:
    """Return data as the text of a JSON file; numbers must be finite."""
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
