"""The trace of a run: every byte on every instrument's wire, for a person to read."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import TextIO

from station.clock import Clock

FOLDER = "trace"
HEAD = """\
# {name}: what went over its wire. Run time in s; > sent, < received, ! a fault, - a remark.
# \\n is a line feed, \\r a carriage return, \\\\ a backslash, \\x00 any other byte in hexadecimal.
# A CAN frame is its identifier, # and its data in hexadecimal, then its name if it has one.
"""
NAMED = {ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t", ord("\\"): "\\\\"}
ESCAPES = [
    NAMED.get(code, chr(code) if 32 <= code < 127 else f"\\x{code:02x}") for code in range(256)
]


def readable(data: bytes) -> str:
    """Return bytes as text in which each of them can be told from every other."""
    return "".join(map(ESCAPES.__getitem__, data))


class Trace:
    """One text file per instrument below `trace/` of a run folder, one line per message.

    It survives the death of the process message by message. It is no part of the record: where it
    cannot be written, this is said once on standard error and the run goes on without it.
    """

    def __init__(self, run_folder: Path, clock: Clock) -> None:
        self.folder = run_folder / FOLDER
        self._clock = clock
        self._files: dict[str, TextIO] = {}
        self._lock = Lock()
        self._failed = False

    def of(self, instrument: str) -> Callable[[str, bytes], None]:
        """Return what an instrument's driver tells of its wire: a direction and the bytes."""

        def tell(direction: str, data: bytes) -> None:
            # Words of ours, unlike bytes of the wire, may hold any letter.
            text = data.decode("utf-8") if direction in "!-" else readable(data)
            with self._lock:
                self._write(instrument, f"{self._clock.now():13.6f} {direction} {text}\n")

        return tell

    def close(self) -> None:
        """Close the files; what is told afterwards is not kept."""
        with self._lock:
            for file in self._files.values():
                try:
                    file.close()
                except OSError as error:
                    self._give_up(error)
            self._files.clear()
            self._failed = True

    def _write(self, instrument: str, line: str) -> None:
        if self._failed:
            return
        try:
            if instrument not in self._files:
                self.folder.mkdir(exist_ok=True)
                path = self.folder / f"{instrument}.txt"
                self._files[instrument] = path.open("w", encoding="utf-8", buffering=1)
                self._files[instrument].write(HEAD.format(name=instrument))
            self._files[instrument].write(line)
        except OSError as error:  # an instrument that is being made safe must not fail over this
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        if not self._failed:
            self._failed = True
            why = error.strerror or error
            print(f"the trace ends here, it cannot be written: {why}", file=sys.stderr)
