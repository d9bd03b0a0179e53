"""Watch a run over the pipe from it, until it is dismissed, dies, or stands still."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import FileIO
from queue import Empty, SimpleQueue
from threading import Thread

from station.errors import StationError
from station.guardian.messages import DISMISS, WATCH

SILENT_FOR_S = 5.0
LOOKS_EVERY_S = 0.25
PIPE_ENDED = "the run's process ended before it had made the bench safe"
STANDS_STILL = f"the run's process gave no sign of life for {SILENT_FOR_S:g} s of real time"


def watch_until_end(
    pipe: FileIO, prepare: Callable[[Sequence[str]], None]
) -> tuple[str | None, list[str]]:
    """Return why the bench must be made safe, None where nothing is to be done, and what of it.

    `prepare` is called with what is to be watched from then on. A run that stands still before it
    has anything to watch is waited for.
    """
    lines: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_read, args=(pipe, lines), name="pipe", daemon=True).start()
    watched: list[str] = []
    looks = 0
    while True:
        try:
            line = lines.get(timeout=LOOKS_EVERY_S)
        except Empty:
            # Looks are counted, not seconds: a guardian that itself stood still has missed nothing
            # that does not lie in the pipe.
            looks += 1
            if watched and looks * LOOKS_EVERY_S >= SILENT_FOR_S:
                return STANDS_STILL, watched
            continue
        looks = 0
        if not line.endswith(b"\n"):
            return PIPE_ENDED, watched
        message = json.loads(line)
        if message["say"] == DISMISS:
            return None, []
        if message["say"] == WATCH:
            watched += [name for name in message["instruments"] if name not in watched]
            with suppress(StationError):  # an instrument without its driver is found out later
                prepare(watched)


def _read(pipe: FileIO, lines: SimpleQueue[bytes]) -> None:
    """Hand on every line; one without its end, or nothing, is the last."""
    while True:
        try:
            line = pipe.readline()
        except OSError:
            line = b""
        lines.put(line)
        if not line.endswith(b"\n"):
            return
