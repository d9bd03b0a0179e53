"""A line of messages between two processes of one run: it never blocks, and says when it ends."""

from __future__ import annotations

import json
import os
import socket
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

LARGEST_READ_BYTES = 1 << 16
MOST_FILES = 100
"""Open files that go with one message; the system takes 253."""


def line_of(message: Mapping[str, Any]) -> bytes:
    """Return a message as a line."""
    return json.dumps(message).encode() + b"\n"


class Channel:
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
            data, files, _, _ = socket.recv_fds(self.end, LARGEST_READ_BYTES, MOST_FILES)
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
