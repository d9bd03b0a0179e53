"""The log of a run as it grows, for whoever watches it from another process."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from pathlib import Path

from station.errors import DamagedRecord
from station.record.events import BrokenChain, Event, LogChain
from station.record.layout import EVENTS


class LogTail:
    """Read what was added to a run's log since the last look; whole lines alone."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / EVENTS
        self._chain = LogChain(self._path)
        self._at = 0

    def new_events(self) -> Iterator[Event]:
        """Yield the events since the last call.

        Raises OSError where the log is gone, and DamagedRecord, at each call, behind the last line
        that is as it was written.
        """
        with self._path.open("rb") as file:
            file.seek(self._at)
            added = file.read()
        chain, damage = copy(self._chain), None
        events = list[tuple[Event, LogChain, int]]()
        try:
            for line in added.split(b"\n")[:-1]:
                events.append((chain.next_event(line), copy(chain), len(line) + 1))
        except DamagedRecord as error:
            damage = error
            if isinstance(error, BrokenChain):
                del events[-1:]
        for event, self._chain, size in events:
            self._at += size
            yield event
        if damage is not None:
            raise damage
