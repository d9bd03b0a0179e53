"""The trace of a run: every byte on every instrument's wire, for a person to read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from threading import Thread
from typing import TextIO
from zlib import adler32, crc32

from station.clock import Clock, RealClock
from station.console import tell

FOLDER = "trace"
LINE_SUMS = ".sums"
"""What the check sums of a transcript's lines are called beside it: one line for each."""
ADDRESS = "# address: "
MAX_WAITING = 20_000
"""Messages that wait for the disk."""
ENDS_WITHIN_S = 5.0
HEAD = """\
# {name}: what went over its wire. Run time in s; > sent, < received, ! a fault, - a remark.
# \\n is a line feed, \\r a carriage return, \\\\ a backslash, \\x00 any other byte in hexadecimal.
# A CAN frame is its identifier, # and its data in hexadecimal, then its name if it has one.
{address}
"""
SEGMENT = "segment-{}"
"""Below the folder: what a process that went on with the run wrote."""
NAMED = {ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t", ord("\\"): "\\\\"}
ESCAPES = [
    NAMED.get(code, chr(code) if 32 <= code < 127 else f"\\x{code:02x}") for code in range(256)
]


def readable(data: bytes) -> str:
    """Return bytes as text in which each of them can be distinguished."""
    return "".join(map(ESCAPES.__getitem__, data))


def sums_of(line: bytes) -> str:
    """Return the check sums of a transcript's line, its end left out."""
    text = line.rstrip(b"\r")
    return f"{adler32(text):08x}{crc32(text):08x}"


class Trace:
    """One text file per instrument below `trace/` of a run folder, one line per message.

    `segment` is that of a process which goes on with a run; 0 began it.

    A thread writes them, message by message, so that no disk holds up an instrument. It is no part
    of the record: where it cannot be written, or not fast enough, this is said on standard error
    and the run goes on without.
    """

    def __init__(self, run_folder: Path, clock: Clock, segment: int = 0) -> None:
        self.folder = run_folder / FOLDER
        if segment:
            self.folder /= SEGMENT.format(segment)
        self._clock = clock
        # Virtual time waits for whoever works; real time, and what flows meanwhile, does not.
        self._waits = not isinstance(clock, RealClock)
        self._lines: Queue[tuple[str, str] | None] = Queue(MAX_WAITING)
        self._lost: Counter[str] = Counter()
        self._files: dict[str, TextIO] = {}
        self._sums: dict[str, TextIO] = {}
        self._addresses: dict[str, str] = {}
        self._failed = False
        self._thread = Thread(target=self._write_on, name="trace", daemon=True)
        self._thread.start()

    def of(self, instrument: str, address: str = "") -> Callable[[str, bytes], None]:
        """Return what an instrument's driver tells of its wire: a direction and the bytes."""
        self._addresses[instrument] = address

        def tell(direction: str, data: bytes) -> None:
            # Words of ours, unlike bytes of the wire, may hold any letter.
            text = data.decode("utf-8") if direction in "!-" else readable(data)
            self._put(instrument, f"{self._clock.now():13.6f} {direction} {text}\n")

        return tell

    def close(self) -> None:
        """Close the files, within 5 s of real time; what comes afterwards is not kept."""
        with suppress(Full):
            self._lines.put(None, timeout=ENDS_WITHIN_S)
            self._thread.join(ENDS_WITHIN_S)
        self._failed = True

    def _put(self, instrument: str, line: str) -> None:
        if self._failed:
            return
        if lost := self._lost[instrument]:
            line = f"{line[:13]} - {lost} messages are left out here: the disk was too slow\n{line}"
        try:
            self._lines.put((instrument, line), block=self._waits)
            self._lost[instrument] = 0
        except Full:
            if not self._lost.total():
                tell("the trace leaves out messages: its disk does not take them as they come")
            self._lost[instrument] += 1

    def _write_on(self) -> None:
        try:
            while (due := self._lines.get()) is not None:
                if not self._failed:
                    self._write(*due)
        finally:
            for file in (*self._files.values(), *self._sums.values()):
                with suppress(OSError):
                    file.close()

    def _write(self, instrument: str, line: str) -> None:
        try:
            if instrument not in self._files:
                self.folder.mkdir(parents=True, exist_ok=True)
                path = self.folder / f"{instrument}.txt"
                self._files[instrument] = path.open("w", encoding="utf-8", buffering=1)
                self._sums[instrument] = path.with_suffix(LINE_SUMS).open("w", encoding="ascii")
                address = f"{ADDRESS}{self._addresses.get(instrument, '')}"
                line = HEAD.format(name=instrument, address=address) + line
            self._files[instrument].write(line)
            for part in line.removesuffix("\n").split("\n"):
                self._sums[instrument].write(f"{sums_of(part.encode())}\n")
        except OSError as error:
            self._failed = True
            tell(f"the trace ends here, it cannot be written: {error.strerror or error}")
