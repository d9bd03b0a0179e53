"""What people wish of a run in a browser, passed on to its process."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any

from station.control.channel import ask
from station.errors import StationError

REQUESTS = ("pause", "go-on", "abort", "answer")
ABORT_WITHIN_S = 120.0
ANSWERS_WITHIN_S = 5.0
Word = dict[str, Any]


class RunRequests:
    """Passes requests on. One to pause waits for its unit of work here, whatever the browser does.

    It is taken back where the panel ends.
    """

    def __init__(self) -> None:
        self._pausing: dict[Path, Word] = {}
        self._lock = Lock()

    def pass_on(self, folder: Path, wish: str, details: Mapping[str, str]) -> Word:
        """Return what the run answers, a pause that takes its time at once; raises StationError."""
        if wish == "pause":
            return self._pause(folder)
        within_s = ABORT_WITHIN_S if wish == "abort" else ANSWERS_WITHIN_S
        return ask(folder, wish, within_s, details=details)

    def _pause(self, folder: Path) -> Word:
        with self._lock:
            if (waits := self._pausing.get(folder)) is not None:
                return waits
        words: SimpleQueue[Word | StationError] = SimpleQueue()

        def meanwhile(word: Word) -> None:
            with self._lock:
                self._pausing[folder] = word
            words.put(word)

        def wait() -> None:
            try:
                words.put(ask(folder, "pause", None, meanwhile=meanwhile))
            except StationError as error:
                words.put(error)
            except (OSError, ValueError) as error:
                words.put(StationError(f"the run's process does not answer: {error}"))
            finally:
                with self._lock:
                    self._pausing.pop(folder, None)

        Thread(target=wait, name="pause", daemon=True).start()
        first = words.get()
        if isinstance(first, StationError):
            raise first
        return first
