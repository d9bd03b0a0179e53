"""CAN frames through python-can: a reader thread that stamps, and requests with a reply frame."""

from __future__ import annotations

import logging
import select
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import can

from drivers.roles import Place
from drivers.transport.kept_frames import READ_SLICE_S, KeptFrames

CONNECT_DEADLINE_S = 2.0
GREETING = b"< hi >"
OPENED = b"< ok >"
CLOSED = "the other side closed the connection"


@dataclass(frozen=True)
class Frame:
    """A received frame: identifier, data and the run time at which it reached the computer."""

    identifier: int
    data: bytes
    arrival_s: float


class CanLine(KeptFrames[Frame]):
    """One connection to a CAN bus; `address` is `socketcand://host:port/channel`.

    `names` are the frames that the instrument sends or takes, by identifier: what else is on the
    bus is not kept.
    """

    line = "the CAN bus"
    when_broken = "check the adapter, its cable and socketcand, then start again"

    def __init__(self, place: Place, names: Mapping[int, str]) -> None:
        parts = urlsplit(place.address)
        super().__init__(place, parts.netloc, lambda frame: frame.identifier)
        self._names = names
        channel = parts.path.strip("/")
        if parts.scheme != "socketcand" or not parts.hostname or not parts.port or not channel:
            raise self._fault(
                f"open {place.address!r}",
                "this is no CAN address",
                "write socketcand://host:port/channel in the bench file",
            )
        # python-can's own log says every fault again, in its own words.
        logging.getLogger("can").setLevel(logging.CRITICAL)
        try:
            # python-can would try a refused connection for ten seconds, and wait for a daemon that
            # does not speak for ever.
            prove_daemon(parts.hostname, parts.port, channel)
            self._bus: Any = can.Bus(
                interface="socketcand", host=parts.hostname, port=parts.port, channel=channel
            )
        except (OSError, can.CanError) as error:
            raise self._nobody_answers(
                first_line(error), "start socketcand, check the adapter"
            ) from error
        self._begin_to_read()

    def send(self, identifier: int, data: bytes) -> None:
        """Put a frame on the bus."""
        message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
        self._traced_frame(">", identifier, data)
        self._wire.sent(1)
        try:
            self._bus.send(message)
        except (OSError, can.CanError) as error:
            raise self._broken(first_line(error)) from error

    def wait_for(self, kind: int, deadline_s: float) -> list[Frame]:
        """Return the frames of an identifier as soon as there are any, or none at run time.

        Raises InstrumentError when the line is gone.
        """
        frames = super().wait_for(kind, deadline_s)
        if not frames and is_closed(self._bus):
            # The reader may not have come to it yet.
            raise self._broken(CLOSED)
        return frames

    def close(self) -> None:
        """Close the connection and end the reader."""
        self._end_reading(2 * READ_SLICE_S)
        with suppress(OSError, can.CanError):
            self._bus.shutdown()

    def _read(self, within_s: float) -> bool:
        try:
            message = self._bus.recv(within_s)
        except (OSError, ValueError, can.CanError) as error:
            self._dead = first_line(error)
            return False
        if message is None:
            if not self._closing.is_set() and is_closed(self._bus):
                self._dead = CLOSED
            return False
        data = bytes(message.data)
        if message.is_error_frame:
            self._traced("!", f"error frame {message.arbitration_id:X}".encode())
            return True
        self._traced_frame("<", message.arbitration_id, data)
        if message.arbitration_id in self._names:
            self._keep([Frame(message.arbitration_id, data, self._clock.now())])
        self._wire.picked_up(1)
        return True

    def _traced_frame(self, direction: str, identifier: int, data: bytes) -> None:
        if self._trace is not None:
            name = self._names.get(identifier, "")
            said = f"{identifier:03X}#{data.hex().upper()} {name}".rstrip()
            self._trace(direction, said.encode())


def prove_daemon(host: str, port: int, channel: str) -> None:
    """Raise OSError unless a socketcand greets at `host:port` and opens `channel`, in good time."""
    with socket.create_connection((host, port), CONNECT_DEADLINE_S) as daemon:
        said = daemon.recv(256)
        if said == GREETING:
            daemon.sendall(f"< open {channel} >".encode())
            said = daemon.recv(256)
            if said == OPENED:
                return
    raise ConnectionError(f"no socketcand with a bus {channel}: {said[:40]!r} came back")


def is_closed(bus: Any) -> bool:
    """Whether the other side of a python-can socketcand bus has closed the connection.

    python-can takes that for a bus without traffic; False where it keeps its socket elsewhere.
    """
    its_socket = getattr(bus, "_SocketCanDaemonBus__socket", None)
    if its_socket is None:
        return False
    try:
        readable, _, _ = select.select([its_socket], [], [], 0)
        return bool(readable) and its_socket.recv(1, socket.MSG_PEEK) == b""
    except (OSError, ValueError):
        return True


def first_line(error: BaseException) -> str:
    """Return what an error says without the traceback that python-can adds to its own."""
    return str(error).partition("Traceback")[0].strip()
