"""Notice while a run goes on that its folder is gone, also where nothing is written for a while."""

from __future__ import annotations

from threading import Event, Thread

from station.clock import Clock
from station.errors import RecordError
from station.record.folder import RunRecord

LOOKS_EVERY_S = 1.0
LONGEST_SILENCE_S = 10.0
"""Real time in which its disk has to answer."""


class FolderWatch:
    """Look once a second in a thread of its own, which a disk may hold up; a context."""

    def __init__(self, record: RunRecord, clock: Clock) -> None:
        self._record = record
        self._clock = clock
        self._ended = Event()

    def __enter__(self) -> FolderWatch:
        Thread(target=self._watch, name="run folder", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Look no more."""
        self._ended.set()

    def _watch(self) -> None:
        with self._clock.pulse("the disk of the run folder", LONGEST_SILENCE_S) as pulse:
            while not self._ended.wait(LOOKS_EVERY_S):
                pulse.beat()
                try:
                    self._record.presence.check()
                except RecordError as error:
                    if not self._ended.is_set():
                        self._clock.interrupt(error)
                    return
