"""CAN frames through python-can: a reader thread that stamps, and requests with a reply frame."""

from __future__ import annotations

import logging
import select
import socket
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, Lock, Thread
from typing import Any
from urllib.parse import urlsplit

import can

from drivers.roles import Place
from station.errors import InstrumentError

CONNECT_DEADLINE_S = 2.0
READ_SLICE_S = 0.2
LOOK_S = 0.005
GREETING = b"< hi >"
OPENED = b"< ok >"
CLOSED = "the other side closed the connection"


@dataclass(frozen=True)
class Frame:
    """A received frame: identifier, data and the run time at which it reached the computer."""

    identifier: int
    data: bytes
    arrival_s: float


class CanLine:
    """One connection to a CAN bus; `address` is `socketcand://host:port/channel`.

    `names` are the frames that the instrument sends or takes, by identifier: what else is on the
    bus is not kept.
    """

    def __init__(self, place: Place, names: Mapping[int, str]) -> None:
        self._place = place
        self._clock = place.clock
        self._trace = place.trace
        self._names = names
        parts = urlsplit(place.address)
        channel = parts.path.strip("/")
        if parts.scheme != "socketcand" or not parts.hostname or not parts.port or not channel:
            raise self._fault(
                f"open {place.address!r}",
                "this is no CAN address",
                "write socketcand://host:port/channel in the bench file",
            )
        self._wire = place.clock.wire(f"{parts.hostname}:{parts.port}")
        self._frames: deque[Frame] = deque()
        self._frames_lock = Lock()
        self._closing = Event()
        self._dead: str | None = None
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
            raise self._fault(
                f"open {place.address}",
                f"nobody answers there ({first_line(error)})",
                "start socketcand, check the adapter and the address in the bench file",
            ) from error
        self._wire.open()
        self._traced("-", b"opened")
        self._reader = Thread(target=self._read, name=f"{place.name} reader", daemon=True)
        self._reader.start()

    def send(self, identifier: int, data: bytes) -> None:
        """Put a frame on the bus."""
        message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
        self._traced(">", data, identifier)
        self._wire.sent(1)
        try:
            self._bus.send(message)
        except (OSError, can.CanError) as error:
            raise self._broken(first_line(error)) from error

    def take(self, *identifiers: int) -> list[Frame]:
        """Return the received frames of these identifiers, in order, and keep the others.

        Raises InstrumentError when the line is gone and nothing is left to take.
        """
        with self._frames_lock:
            taken = [frame for frame in self._frames if frame.identifier in identifiers]
            if taken:
                kept = [frame for frame in self._frames if frame.identifier not in identifiers]
                self._frames.clear()
                self._frames.extend(kept)
        if not taken and self._dead is not None:
            raise self._broken(self._dead)
        return taken

    def newest(self, identifier: int) -> Frame | None:
        """Return the last received frame of `identifier` that nobody has taken yet, and keep it.

        Raises InstrumentError when the line is gone.
        """
        with self._frames_lock:
            found = next(
                (one for one in reversed(self._frames) if one.identifier == identifier), None
            )
        if found is None and self._dead is not None:
            raise self._broken(self._dead)
        return found

    def wait_for(self, identifier: int, deadline_s: float) -> list[Frame]:
        """Return the frames of `identifier` as soon as there are any, or none at run time.

        Raises InstrumentError when the line is gone.
        """
        while not (frames := self.take(identifier)) and self._clock.now() < deadline_s:
            self._clock.sleep(LOOK_S)
        if not frames and is_closed(self._bus):
            # The reader may not have come to it yet.
            raise self._broken(CLOSED)
        return frames

    def close(self) -> None:
        """Close the connection and end the reader."""
        if not self._closing.is_set():
            self._traced("-", b"closed")
        self._closing.set()
        self._wire.close()
        self._reader.join(2 * READ_SLICE_S)
        with suppress(OSError, can.CanError):
            self._bus.shutdown()

    def _read(self) -> None:
        while not self._closing.is_set():
            try:
                message = self._bus.recv(READ_SLICE_S)
            except (OSError, ValueError, can.CanError) as error:
                self._dead = first_line(error)
                return
            if message is None:
                if not self._closing.is_set() and is_closed(self._bus):
                    self._dead = CLOSED
                    return
                continue
            data = bytes(message.data)
            if message.is_error_frame:
                self._traced("!", f"error frame {message.arbitration_id:X}".encode())
                continue
            self._traced("<", data, message.arbitration_id)
            if message.arbitration_id in self._names:
                frame = Frame(message.arbitration_id, data, self._clock.now())
                with self._frames_lock:
                    self._frames.append(frame)
            self._wire.picked_up(1)

    def _traced(self, direction: str, data: bytes, identifier: int | None = None) -> None:
        if self._trace is None:
            return
        if identifier is not None:
            name = self._names.get(identifier, "")
            data = f"{identifier:03X}#{data.hex().upper()} {name}".rstrip().encode()
        self._trace(direction, data)

    def _broken(self, why: str) -> InstrumentError:
        return self._fault(
            "used the CAN bus",
            f"the line broke ({why})",
            "check the adapter, its cable and socketcand, then start again",
        )

    def _fault(self, attempted: str, came_back: str, do_now: str) -> InstrumentError:
        self._traced("!", f"{attempted}: {came_back}".encode())
        return InstrumentError(self._place.name, attempted, came_back, do_now)


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
