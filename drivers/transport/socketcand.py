"""A connection to a CAN bus behind the public socketcand daemon, in raw mode.

From the daemon's protocol: it greets with `< hi >`, answers `< open BUS >` and `< rawmode >` with
`< ok >`, then sends `< frame ID TIME DATA >` for every frame on the bus and takes
`< send ID LENGTH DATA >`. Bytes come as TCP cuts them: a frame may lie in one segment with the last
`< ok >`, and any message may come in pieces. What is left after the opening are the first frames.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from drivers.transport.serial_port import CONNECT_DEADLINE_S, SocketPort, connected
from station.clock import boot_seconds

GREETING, OPENED = b"< hi >", b"< ok >"
LONGEST_MESSAGE = 256
"""A frame of eight bytes takes less than 60 characters."""

EXTENDED_ID_DIGITS = 8


class Message(NamedTuple):
    """What the daemon said: a frame on the bus, or an error frame, whose data are not told."""

    identifier: int
    data: bytes
    is_error: bool


class Socketcand:
    """One bus in raw mode; raises OSError where no daemon opens it within two seconds.

    `passed_over` is called with bytes that are no message.
    """

    def __init__(
        self, host: str, port: int, bus: str, passed_over: Callable[[bytes], None]
    ) -> None:
        self._passed_over = passed_over
        self._pending = b""
        self._port: SocketPort = connected(host, port)
        try:
            self._expect(GREETING, f"no socketcand with a bus {bus}")
            for request in (f"< open {bus} >", "< rawmode >"):
                self._port.write(request.encode("ascii"))
                self._expect(OPENED, f"no socketcand with a bus {bus}")
        except BaseException:
            self._port.close()
            raise

    def receive(self, within_s: float) -> list[Message]:
        """Return the messages that have come, or come within a real time; raises OSError."""
        whole = b">" in self._pending  # they came with the end of the opening
        self._pending += self._port.read(0.0 if whole else within_s)
        *texts, self._pending = self._pending.split(b">")
        if len(self._pending) > LONGEST_MESSAGE:
            self._passed_over(self._pending)
            self._pending = b""
        return [one for text in texts if (one := self._message(text)) is not None]

    def send(self, identifier: int, data: bytes) -> None:
        """Put a frame on the bus."""
        name = f"{identifier:03X}" if identifier < 0x800 else f"{identifier:08X}"
        octets = " ".join(f"{one:x}" for one in data)
        self._port.write(f"< send {name} {len(data):X} {octets} >".encode("ascii"))

    def close(self) -> None:
        """Close the connection."""
        self._port.close()

    def _expect(self, wanted: bytes, otherwise: str) -> None:
        """Wait for a message of the opening; what comes behind it is kept."""
        until_s = boot_seconds() + CONNECT_DEADLINE_S
        while b">" not in self._pending and len(self._pending) <= LONGEST_MESSAGE:
            left_s = until_s - boot_seconds()
            if left_s <= 0.0:
                raise TimeoutError(f"{otherwise}: {self._pending[:40]!r} came back")
            self._pending += self._port.read(left_s)
        said, _, behind = self._pending.partition(b">")
        if (said + b">").strip() != wanted:
            raise ConnectionError(f"{otherwise}: {self._pending[:40]!r} came back")
        self._pending = behind

    def _message(self, text: bytes) -> Message | None:
        """Return what a message says, None for what is no frame."""
        words = text.partition(b"<")[2].decode("ascii", "replace").split()
        try:
            if words[0] not in ("frame", "error"):
                raise ValueError
            identifier = int(words[1], 16)
            float(words[2])
            return Message(identifier, bytes.fromhex("".join(words[3:])), words[0] == "error")
        except (IndexError, ValueError):
            self._passed_over(text)
            return None
