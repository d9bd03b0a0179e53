"""What a run sets and reads just now, as another process sees it: asked for, never waited for."""

from __future__ import annotations

from pathlib import Path
from threading import Lock, Thread
from typing import Any

from station.clock import RealClock, boot_seconds
from station.control.client import ask
from station.errors import StationError

EVERY_S, AGAIN_S = 0.25, 1.0
"""Real time between two questions, and after one that was not answered."""
OLD_AFTER_S = 3.0
"""Real time after which an answer is not shown any more."""
UNUSED_S = 5.0
"""Real time without a viewer after which the run is not asked any more."""


class LiveValues:
    """The newest answer of a run to `live`; a thread asks while somebody looks."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._newest: tuple[float, dict[str, Any]] | None = None
        self._looked_s = 0.0
        self._asks = False
        self._lock = Lock()

    def newest(self) -> dict[str, Any] | None:
        """Return `instruments` and `interlocks`; None where the run has not answered lately."""
        self._looked_s = boot_seconds()
        with self._lock:
            if not self._asks:
                self._asks = True
                Thread(target=self._ask, name="live values", daemon=True).start()
        newest = self._newest
        if newest is None or boot_seconds() - newest[0] > OLD_AFTER_S:
            return None
        return newest[1]

    def _ask(self) -> None:
        while boot_seconds() - self._looked_s < UNUSED_S:
            try:
                word = ask(self._folder, "live")
                wait_s = EVERY_S
            except (StationError, OSError):  # it ended, or hangs: what is shown grows old
                word, wait_s = {}, AGAIN_S
            if "instruments" in word:
                self._newest = boot_seconds(), word
            RealClock().sleep(wait_s)
        with self._lock:
            self._asks = False
