"""What a guardian says while it acts: in its log and on standard error, in threads of their own.

A disk or a terminal that hangs may be why the run died. It must not hold up the safe state.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

from station.clock import Clock, utc_now
from station.console import tell
from station.errors import RecordError
from station.guardian.log import GUARDIAN_LOG
from station.record.creation import EVENTS
from station.record.events import EventLog

LAST_WORDS_S = 10.0


class Background:
    """Do one thing after the other, in order, in a thread that nobody waits for."""

    def __init__(self, name: str) -> None:
        self._due: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def do(self, what: Callable[[], None]) -> None:
        """Do `what` when everything before it is done."""
        self._due.put(what)

    def finish(self, within_s: float) -> None:
        """Wait until everything is done, or `within_s` of real time have passed."""
        self._due.put(None)
        self._thread.join(within_s)

    def _work(self) -> None:
        while (what := self._due.get()) is not None:
            what()


class Notes:
    """The guardian's log in the run folder, every event on disk, and its words to the operator."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._folder = folder
        self._clock = clock
        self._log: EventLog | None = None
        self._events = 0
        self._writing = Background("log")
        self._telling = Background("standard error")

    def note(self, kind: str, **details: Any) -> None:
        """Append an event of this moment, with its UTC."""
        time_s, utc = self._clock.now(), utc_now().isoformat(timespec="milliseconds")
        self._writing.do(lambda: self._append(time_s, kind, {"utc": utc, **details}))

    def tell(self, text: str) -> None:
        """Say something to the operator."""
        self._telling.do(lambda: tell(f"guardian: {text}"))

    def close(self) -> None:
        """Wait until everything is written and said, at most 10 s for each."""
        self._writing.finish(LAST_WORDS_S)
        self._telling.finish(LAST_WORDS_S)
        sys.stderr.flush()

    def _append(self, time_s: float, kind: str, details: dict[str, Any]) -> None:
        try:
            if self._log is None:
                # The run has ended: what it wrote by now is all that came before.
                self._events = (self._folder / EVENTS).read_bytes().count(b"\n")
                self._log = EventLog(self._folder / GUARDIAN_LOG)
            details = {"after_events": self._events, **details}
            self._log.append(time_s, kind, details, durable=True)
        except (RecordError, OSError) as error:
            self.tell(f"not recorded: {error}")
