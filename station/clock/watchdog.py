"""Notice that virtual time hangs: no turn passes and the process does no work."""

from __future__ import annotations

import time
from threading import Event, Thread

from station.clock.turns import Turns

HANGS_AFTER_S = 6.0
LOOKS_EVERY_S = 0.5
WORKING_SHARE = 0.1
"""A process that uses this share of a processor computes; it does not hang."""


class Watchdog:
    """Turn a deadlock into an error that names the waiting threads."""

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._ended = Event()
        self._thread: Thread | None = None
        self.persons_asked = 0

    def begin(self) -> None:
        """Start watching; a second call does nothing."""
        if self._thread is None:
            self._thread = Thread(target=self._watch, name="clock-watchdog", daemon=True)
            self._thread.start()

    def end(self) -> None:
        """Stop watching."""
        self._ended.set()

    def _watch(self) -> None:
        seen: tuple[int, int] | None = None
        still_since, worked_at = time.monotonic(), time.process_time()
        while not self._ended.wait(LOOKS_EVERY_S):
            turns = self._turns
            state = (turns.passed, turns.in_flight)
            idle = turns.running is None and not turns.waiting and not turns.in_flight
            elapsed = time.monotonic() - still_since
            working = time.process_time() - worked_at > WORKING_SHARE * elapsed
            if state != seen or idle or self.persons_asked or (elapsed > HANGS_AFTER_S and working):
                seen, still_since, worked_at = state, time.monotonic(), time.process_time()
            elif elapsed > HANGS_AFTER_S:
                with turns.mutex:
                    turns.fail(f"time stands still, every thread waits: {turns.describe()}")
                return
