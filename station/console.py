"""Messages to the operator: a terminal that is gone or stands still holds up nobody.

What is written to standard error waits in a queue for a thread that may be blocked by a terminal
whose output was stopped. Where the queue is full, what follows is dropped, and how much is said
when the terminal goes on. What is written to standard output is the result of a command: it is
written at once and whole, or the command fails.
"""

from __future__ import annotations

import atexit
import os
import sys
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any, TextIO, cast

from station.clock import RealClock
from station.errors import StationError
from station.speech import said

MAX_WAITING = 500
"""Pieces of text that wait for a terminal."""
MAX_LOOKS, LOOKS_EVERY_S = 50, 0.005
"""So long a full queue is waited for, once: then its terminal stands still."""
LAST_WORDS_S = 2.0
IN_ORDER_WITHIN_S = 0.5
STANDARD = range(3)


class OutputLost(StationError):
    """Standard output that does not take what a command has to say."""


class NonBlockingStderr:
    """Standard error as a queue, written to the terminal by a thread of its own."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._waiting: SimpleQueue[bytes | Event] = SimpleQueue()
        self._dropping = False
        self._dropped = 0
        self._gone = False
        Thread(target=self._write_on, name="standard error", daemon=True).start()

    def __getattr__(self, name: str) -> Any:  # its encoding, its handle, whether it is a terminal
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Queue a text; where a terminal stands still it is dropped."""
        if self._takes_more():
            self._waiting.put(encoded(text, self._stream))
        else:
            self._dropped += text.count("\n")
        return len(text)

    def flush(self) -> None:
        """Wait for nobody."""

    @property
    def idle(self) -> bool:
        """Whether the terminal has taken everything so far."""
        return self._waiting.empty()

    def drain(self, within_s: float) -> bool:
        """Wait in real time until everything is written, and no longer than that; whether it is."""
        self._say_what_was_dropped()
        written = Event()
        self._waiting.put(written)
        return written.wait(within_s)

    def _takes_more(self) -> bool:
        """Whether there is room; a terminal that is only slow is waited for."""
        if self._dropping and self._waiting.qsize() > MAX_WAITING // 2:
            return False
        clock, looks = RealClock(), 0
        while self._waiting.qsize() >= MAX_WAITING:
            if (looks := looks + 1) > MAX_LOOKS:
                self._dropping = True
                return False
            clock.sleep(LOOKS_EVERY_S)
        if self._dropping:
            self._dropping = False
            self._say_what_was_dropped()
        return True

    def _say_what_was_dropped(self) -> None:
        dropped, self._dropped = self._dropped, 0
        if dropped:
            text = f"({dropped} lines are left out here: nobody took them for a while)\n"
            self._waiting.put(encoded(text, self._stream))

    def _write_on(self) -> None:
        handle = self._stream.fileno()
        while True:
            piece = self._waiting.get()
            if isinstance(piece, Event):
                piece.set()
            elif not self._gone:
                try:
                    write_whole(handle, piece)
                except OSError:  # a closed terminal: the record has it all
                    self._gone = True


class Whole:
    """Standard output without a buffer that could fail, or block, at the end of the process."""

    def __init__(self, stream: TextIO | None, messages: NonBlockingStderr | None = None) -> None:
        self._stream = stream
        self._messages = messages
        """What was written before, elsewhere: on a terminal it is to stand before."""
        self._over = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text; raises OutputLost where it cannot be, once.

        Where the reader of a pipe has gone nothing is lost that anybody wants.
        """
        if self._over:
            return len(text)
        if self._messages is not None and not self._messages.drain(IN_ORDER_WITHIN_S):
            self._messages = None  # that terminal stands still: it is not waited for again
        try:
            if self._stream is None:
                raise OSError("it is closed")
            write_whole(self._stream.fileno(), encoded(text, self._stream))
        except BrokenPipeError:
            self._over = True
        except OSError as error:
            self._over = True
            raise OutputLost(
                "the results could not be written to standard output "
                f"({error.strerror or error}); they are incomplete there"
            ) from error
        except KeyboardInterrupt:  # nobody waits for the rest
            self._over = True
            raise
        return len(text)

    def flush(self) -> None:
        """Do nothing: nothing waits here."""

    def isatty(self) -> bool:
        """Whether a person reads."""
        return self._stream is not None and self._stream.isatty()


def encoded(text: str, stream: TextIO) -> bytes:
    """Return a text in the encoding of a stream; what that does not know is escaped."""
    if os.linesep != "\n":
        text = text.replace("\n", os.linesep)
    return text.encode(stream.encoding or "utf-8", errors="backslashreplace")


def holds_every_sign(stream: TextIO) -> bool:
    """Whether the encoding of a stream has signs of other languages than English."""
    try:
        "中".encode(getattr(stream, "encoding", None) or "utf-8")
    except UnicodeError:
        return False
    return True


def write_whole(handle: int, data: bytes) -> None:
    """Write all of it, however long that takes; raises OSError."""
    left = memoryview(data)
    while left:
        left = left[os.write(handle, left) :]


def take_over_streams() -> None:
    """Make the standard streams of this process safe to use, until it ends.

    One that was closed when the process began is opened on nothing, so that no file of a run is
    ever opened in its place. One that another program has put there, without a handle of the
    system, stays as it is.
    """
    closed = set(map(open_on_nothing, STANDARD))
    if sys.stdin is None:
        sys.stdin = os.fdopen(0, encoding="utf-8")
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", encoding="utf-8")
    ours = None
    if has_handle(sys.stderr):
        ours = NonBlockingStderr(sys.stderr)
        sys.stderr = cast(TextIO, ours)
        atexit.register(ours.drain, LAST_WORDS_S)
    if os.name == "posix" and (1 in closed or has_handle(sys.stdout)):
        # A console of Windows takes no bytes.
        sys.stdout = cast(TextIO, Whole(None if 1 in closed else sys.stdout, ours))


def has_handle(stream: TextIO | None) -> bool:
    """Whether the system knows a stream by a number."""
    if stream is None or isinstance(stream, NonBlockingStderr | Whole):
        return False
    try:
        stream.fileno()
    except (OSError, ValueError):
        return False
    return True


def open_on_nothing(handle: int) -> int | None:
    """Open a standard stream on nothing where it is closed, and return its number if it was."""
    try:
        os.fstat(handle)
    except OSError:
        opened = os.open(os.devnull, os.O_RDWR)
        if opened != handle:
            os.dup2(opened, handle)
            os.close(opened)
        os.set_inheritable(handle, True)  # as a standard stream is: the guardian has it, too
        return handle
    return None


def tell(text: str, end: str = "\n") -> None:
    """Write a line to standard error in the language of this terminal.

    Nothing is written where nobody reads it any more.
    """
    try:
        sys.stderr.write(said(text) + end)
        sys.stderr.flush()
    except (OSError, ValueError):  # a broken pipe, a closed terminal: the record has it all
        return


def span(seconds: float) -> str:
    """Return a span of time for a person: `45 s`, `12 min 30 s`, `5 h 10 min`."""
    whole = round(max(seconds, 0.0))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def no_older(age_s: float) -> str:
    """Return the age of the oldest of several readings in words."""
    return f"no reading older than {max(age_s, 0.1):.1f} s"
