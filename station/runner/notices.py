"""Let a person know, who is not at the bench: the program that the bench file names is started."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from threading import Thread

from station.console import tell

ENDS_WITHIN_S = 30.0
"""Real time after which a program that does not end is killed."""
LAST_S = 2.0
"""Real time that the end of a run waits until the program has begun."""


class Notices:
    """Start a program at a prompt and at the end; a run never waits for it, nor fails by it.

    It gets what happened in its environment: STATION_EVENT (`prompt` or `ended`), STATION_RUN,
    STATION_BENCH, STATION_SERIAL and STATION_MESSAGE.
    """

    def __init__(self, command: Sequence[str], run: Path, bench: str, serial: str) -> None:
        self._command = list(command)
        self._known = {
            "STATION_RUN": str(run.resolve()),
            "STATION_BENCH": bench,
            "STATION_SERIAL": serial,
        }

    def prompt(self, text: str) -> None:
        """A person is asked."""
        self._start("prompt", text)

    def ended(self, message: str) -> None:
        """The run is over and its bench was left as it is."""
        begun = self._start("ended", message)
        if begun is not None:
            begun.join(LAST_S)

    def _start(self, kind: str, message: str) -> Thread | None:
        if not self._command:
            return None
        facts = {**self._known, "STATION_EVENT": kind, "STATION_MESSAGE": message}
        began = Thread(target=self._begin, args=(facts,), name="notice", daemon=True)
        began.start()
        return began

    def _begin(self, facts: dict[str, str]) -> None:
        try:
            process = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **facts},
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            tell(f"WARNING: no notification was sent: {self._command[0]}: {error}")
            return
        Thread(target=watch, args=(process,), name="notice ends", daemon=True).start()


def watch(process: subprocess.Popen[bytes]) -> None:
    """Kill a program that does not end, and say where it fails."""
    try:
        code = process.wait(ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        code = process.wait()
    if code:
        tell(f"WARNING: the program of `notify` ended with {code}")
