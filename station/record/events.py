"""events.jsonl: one line an event, each with the SHA-256 of the line before."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.errors import DamagedRecord
from station.record.files import AppendOnlyFile

FIRST_HASH = "0" * 64
RESUMED = "resumed"
"""The event with which another process goes on with a run."""

LEFT_FOR_THE_END = "prompt-left"
"""Logs a request that a person is put only once bench and results are done."""


@dataclass(frozen=True)
class Event:
    """One line of the log: run time in s, what happened, and its details."""

    time_s: float
    kind: str
    details: dict[str, Any]


class EventLog:
    """Append events so that each survives the death of the process before the caller goes on.

    A log that is there already is gone on with; a last line cut short is taken out of it first.
    """

    def __init__(self, path: Path) -> None:
        self._previous = FIRST_HASH
        if path.is_file():
            log = path.read_bytes()
            for _, self._previous in checked_lines(path, log):
                pass
            whole = log.rfind(b"\n") + 1
            if whole < len(log):
                os.truncate(path, whole)
        self._file = AppendOnlyFile(path, new=False)

    def append(self, time_s: float, kind: str, details: dict[str, Any], *, durable: bool) -> None:
        """Write one event at run time `time_s`; `durable` waits until the disk has it.

        Raises RecordError; the log then ends with its last whole line.
        """
        line = json.dumps(
            {"t_s": round(time_s, 9), "event": kind, **details, "previous": self._previous},
            ensure_ascii=False,
            allow_nan=False,
        ).encode()
        self._file.append(line + b"\n")
        self._previous = hashlib.sha256(line).hexdigest()
        if durable:
            self._file.sync()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_events(path: Path) -> Iterator[Event]:
    """Yield the events of a log; a last line cut short by a crash is left out.

    Raises DamagedRecord when a line does not follow the one before it. A change of the last line
    is not seen here: nothing follows it that holds its hash. The manifest covers it.
    """
    return (event for event, _ in checked_lines(path, path.read_bytes()))


def checked_lines(path: Path, log: bytes) -> Iterator[tuple[Event, str]]:
    """Yield each event of the log's bytes with its line's SHA-256; errors as `read_events`."""
    previous = FIRST_HASH
    lines = log.split(b"\n")
    # What follows the last line end is empty, or was cut short.
    for number, line in enumerate(lines[:-1], start=1):
        try:
            data = json.loads(line)
            said, time_s, kind = data.pop("previous"), float(data.pop("t_s")), data.pop("event")
        except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
            raise DamagedRecord(
                f"{path}:{number}: the log was altered: this line is no event"
            ) from error
        if said != previous:
            which = f"line {number - 1} is not" if number > 1 else "the first line is not"
            raise DamagedRecord(
                f"{path}:{number}: the log was altered: {which} the one that was written"
            )
        previous = hashlib.sha256(line).hexdigest()
        yield Event(time_s, kind, data), previous
