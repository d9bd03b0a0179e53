"""A terminal of a given size for a verb in a process of its own, and what its screen shows."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import struct
import subprocess
import termios
import time
from pathlib import Path
from threading import Lock, Thread

from command_line import station_command

WITHIN_S = 60.0
CODE = re.compile(r"\x1b\[(\??)([0-9;]*)([A-Za-z])")


def hears_hang_up() -> None:
    """Take SIGHUP as a terminal's program does, also where the tests run under `nohup`."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


class Screen:
    """The lines of a terminal; it knows the codes that the station sends, and refuses others."""

    def __init__(self, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, rows
        self.lines = [""] * rows
        self.past: list[str] = []
        """What scrolled out at the top."""
        self.wrapped = 0
        """How often a line was longer than the screen."""
        self._row = self._column = 0
        self._waits = ""

    def take(self, text: str) -> None:
        """Show what a program writes."""
        text, at = self._waits + text, 0
        self._waits = ""
        while at < len(text):
            if text[at] == "\x1b":
                code = CODE.match(text, at)
                if code is None:
                    self._waits = text[at:]
                    return
                self._do(*code.groups())
                at = code.end()
                continue
            self._put(text[at])
            at += 1

    def _put(self, one: str) -> None:
        if one == "\r":
            self._column = 0
        elif one == "\n":
            self._down()
        elif one != "\a":
            if self._column == self.columns:
                self.wrapped += 1
                self._column = 0
                self._down()
            line = self.lines[self._row].ljust(self._column)
            self.lines[self._row] = line[: self._column] + one + line[self._column + 1 :]
            self._column += 1

    def _down(self) -> None:
        if self._row < self.rows - 1:
            self._row += 1
            return
        self.past.append(self.lines.pop(0))
        self.lines.append("")

    def _do(self, private: str, number: str, code: str) -> None:
        if private or code == "m":
            return
        match code, number:
            case "A", _:
                self._row = max(self._row - int(number or 1), 0)
            case "H", "":
                self._row = self._column = 0
            case "J", "2":
                self.lines = [""] * self.rows
            case "K", "2":
                self.lines[self._row] = ""
            case _:
                raise AssertionError(f"an unknown code: {number}{code}")


class OnTerminal:
    """A verb on a pseudo-terminal of its own, typed at like a person does."""

    def __init__(
        self, folder: Path, *arguments: str | Path, columns: int = 80, rows: int = 24
    ) -> None:
        self._master, slave = pty.openpty()
        size = struct.pack("HHHH", rows, columns, 0, 0)
        fcntl.ioctl(slave, termios.TIOCSWINSZ, size)
        self.shown = ""
        self._screen = Screen(columns, rows)
        self._lock = Lock()
        without = ("CI", "COLUMNS", "LINES", "NO_COLOR")
        environment = {key: value for key, value in os.environ.items() if key not in without}
        self.process = subprocess.Popen(
            station_command(*arguments),
            cwd=folder,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            preexec_fn=hears_hang_up,
            env={**environment, "TERM": "xterm-256color"},
        )
        os.close(slave)
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        waits = b""
        try:
            while data := os.read(self._master, 65536):
                waits += data
                text = waits.decode(errors="ignore")
                waits = waits[len(text.encode()) :]
                with self._lock:
                    self._screen.take(text)
                    self.shown += text
        except OSError:
            return

    @property
    def lines(self) -> list[str]:
        """What stands on the screen just now, without blanks at the ends of lines."""
        with self._lock:
            return [line.rstrip() for line in self._screen.lines]

    @property
    def past(self) -> list[str]:
        """What scrolled out of the screen."""
        with self._lock:
            return [line.rstrip() for line in self._screen.past]

    @property
    def wrapped(self) -> int:
        """How many lines were longer than the screen."""
        return self._screen.wrapped

    def wait_for(self, text: str) -> None:
        """Wait until a text was shown."""
        until_s = time.monotonic() + WITHIN_S
        while text not in self.shown:
            assert time.monotonic() < until_s, self.shown
            time.sleep(0.02)

    def type(self, text: str) -> None:
        """Press keys."""
        os.write(self._master, text.encode())

    def ended(self) -> int:
        """Wait for the end of the verb, and for all that it wrote; return its exit code."""
        code = self.process.wait(WITHIN_S)
        self._reader.join(WITHIN_S)
        return code
