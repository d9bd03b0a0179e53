"""The log of a run as it grows, for whoever watches it from another process."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from station.errors import DamagedRecord
from station.record.events import Event
from station.record.layout import EVENTS


class LogTail:
    """Read what was added to a run's log since the last look; whole lines alone."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / EVENTS
        self._at = 0

    def new_events(self) -> Iterator[Event]:
        """Yield the events since the last call.

        Raises OSError where the log is gone, and DamagedRecord at each line that is no event.
        """
        with self._path.open("rb") as file:
            file.seek(self._at)
            added = file.read()
        whole = added[: added.rfind(b"\n") + 1]
        for line in whole.splitlines(keepends=True):
            try:
                data = json.loads(line)
                data.pop("previous", None)
                event = Event(float(data.pop("t_s")), str(data.pop("event")), data)
            except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
                raise DamagedRecord(
                    f"{self._path}: the log was altered: what stands at byte {self._at} is no event"
                ) from error
            self._at += len(line)
            yield event
