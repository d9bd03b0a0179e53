"""The line between a run and its guardians, and what goes over it: one JSON object a line.

It never blocks, and says when it ends. A word that a process does not know is passed over.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

LARGEST_READ_BYTES = 1 << 16
MAX_FILES = 100
"""Open files that go with one message; the system takes 253."""


def line_of(message: Mapping[str, Any]) -> bytes:
    """Return a message as a line."""
    return json.dumps(message).encode() + b"\n"


class GuardianLine:
    """One end of a stream socket: a JSON object a line, open files beside it (not on Windows)."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self.end = end
        self.ended = False
        """Whether the other end is gone, or takes no whole lines any more."""
        self._rest = b""
        self._files: deque[int] = deque()
        self._come: deque[dict[str, Any]] = deque()

    def send(self, message: Mapping[str, Any], files: Sequence[int] = ()) -> bool:
        """Send a message; False, at once, where nobody takes it."""
        data = {**message, "files": len(files)} if files else message
        return self.send_line(line_of(data), files)

    def send_line(self, line: bytes, files: Sequence[int] = ()) -> bool:
        """As `send`, of a message that is made already."""
        if self.ended:
            return False
        try:
            sent = socket.send_fds(self.end, [line], files) if files else self.end.send(line)
        except BlockingIOError:  # whoever is there has not read for long
            return False
        except OSError:
            self.ended = True
            return False
        # What is left of a line could only follow later: others would be glued to its beginning.
        self.ended = sent < len(line)
        return not self.ended

    def received(self) -> Iterator[tuple[dict[str, Any], list[int]]]:
        """Yield the whole messages that have come, each with its open files."""
        self._read_all()
        while self._come:
            message = self._come.popleft()
            yield message, [self._files.popleft() for _ in range(message.get("files", 0))]

    def _read_all(self) -> None:
        while not self.ended:
            try:
                data = self._read()
            except BlockingIOError:
                return
            except OSError:
                data = b""
            self.ended = not data
            *lines, self._rest = (self._rest + data).split(b"\n")
            self._come.extend(json.loads(line) for line in lines)

    def close(self) -> None:
        """Close this end."""
        self.ended = True
        self.end.close()

    if sys.platform == "win32":

        def _read(self) -> bytes:
            return self.end.recv(LARGEST_READ_BYTES)

    else:

        def _read(self) -> bytes:
            data, files, _, _ = socket.recv_fds(self.end, LARGEST_READ_BYTES, MAX_FILES)
            for file in files:
                os.set_inheritable(file, False)
            self._files.extend(files)
            return data


if sys.platform == "win32":
    SHARE_BYTES = 4096
    """What `share` gives is shorter; it is filled up."""

    def given_by_parent() -> socket.socket:
        """Return the socket that the starting process shares over standard input."""
        return socket.fromshare(sys.stdin.buffer.read(SHARE_BYTES).rstrip(b"\n"))

else:

    def given_by_parent() -> socket.socket:
        """Return the socket that the starting process gave as standard input."""
        return socket.socket(fileno=os.dup(0))


BEAT = "beat"
"""A sign of life, in every direction."""
WATCH = "watch"
"""From the run, with `instruments`: these are to be made safe from now on."""
LOCKS = "locks"
"""From the run, with the names of locks in `keys` and the locked files: hold them, too."""
WITNESSES = "witnesses"
"""From the run, with `sightings`: what second instruments saw of the sources that are driven."""
PEER = "peer"
"""From the run, with a socket and the `pid` at its other end: the other guardian."""
HAND_OVER = "hand-over"
"""From the run, with `why`: it has let go of the instruments, not all of which are safe."""
DISMISS = "dismiss"
"""From the run: it has made the bench safe itself."""
WAITS = "waits"
"""From one guardian to the other: it goes on trying, and has written that for the operator."""
DONE = "done"
"""From one guardian to the other: nothing is left to be done."""
BEATS_EVERY_S = 1.0
LOOKS_EVERY_S = 0.25
SILENT_FOR_S = 5.0


@dataclass(frozen=True)
class Instructions:
    """The first line: everything that a guardian needs when nobody can be asked any more.

    `bench` is the path of the resolved bench file, `instruments` are those whose drivers must be
    ready, `addresses` replace those of the bench file; `speed` and `epoch_unix` are the run's time.
    The guardian of rank 0 acts first, that of rank 1 when the first is gone or stands still.
    `world` sets the instruments of a simulated bench apart from others that report the same.
    `bench_file` is the bench file as the operator named it, which is refused where a witness
    contradicts what was read back; `real` whether its instruments are.
    """

    folder: str
    bench: str
    instruments: Sequence[str]
    addresses: Mapping[str, str]
    runner_pid: int
    speed: float
    epoch_unix: float
    rank: int = 0
    world: str = ""
    bench_file: str = ""
    real: bool = False

    def to_data(self) -> dict[str, Any]:
        """Return the instructions as plain data."""
        return asdict(self)


def message_of(what: str, **details: Any) -> dict[str, Any]:
    """Return a message."""
    return {"say": what, **details}


class Silence:
    """For how long somebody has said nothing.

    Looks are counted, not seconds: whoever stood still itself, or slept with the whole computer,
    has missed nothing that does not wait to be read.
    """

    def __init__(self) -> None:
        self._looks = 0

    @property
    def seconds(self) -> float:
        """Real time in s."""
        return self._looks * LOOKS_EVERY_S

    def heard(self) -> None:
        """Begin anew."""
        self._looks = 0

    def look(self) -> None:
        """Count a look, none sooner than `LOOKS_EVERY_S` after the one before."""
        self._looks += 1


class Looks:
    """When the next look is due; one that is late is not made up for."""

    def __init__(self) -> None:
        from station.clock import boot_seconds

        self._now = boot_seconds
        self._last_s = boot_seconds()

    def due(self) -> bool:
        """Whether `LOOKS_EVERY_S` have passed since the last look; this is then the next."""
        if self._now() - self._last_s < LOOKS_EVERY_S:
            return False
        self._last_s = self._now()
        return True
