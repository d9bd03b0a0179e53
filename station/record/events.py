"""events.jsonl: one line an event, each with the SHA-256 of the line before."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.errors import RecordError
from station.record.files import AppendOnlyFile

FIRST_HASH = "0" * 64


@dataclass(frozen=True)
class Event:
    """One line of the log: run time in s, what happened, and its details."""

    time_s: float
    kind: str
    details: dict[str, Any]


class EventLog:
    """Append events so that each survives the death of the process before the caller goes on."""

    def __init__(self, path: Path) -> None:
        self._file = AppendOnlyFile(path, new=False)
        self._previous = FIRST_HASH

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

    Raises RecordError when a line does not follow the one before it.
    """
    previous = FIRST_HASH
    lines = path.read_bytes().split(b"\n")
    for number, line in enumerate(lines, start=1):
        if number == len(lines):
            return  # what follows the last line end is empty, or was cut short
        data = json.loads(line)
        if data.pop("previous") != previous:
            raise RecordError(
                f"{path}:{number}: the log was altered: the chain of hashes breaks here"
            )
        previous = hashlib.sha256(line).hexdigest()
        yield Event(data.pop("t_s"), data.pop("event"), data)
