"""CAN frames through python-can: a reader thread that stamps, and requests with a reply frame."""

from __future__ import annotations

import logging
import socket
from collections import deque
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
EMPTY_READS_OF_A_DEAD_LINE = 1000


@dataclass(frozen=True)
class Frame:
    """A received frame: identifier, data and the run time at which it reached the computer."""

    identifier: int
    data: bytes
    arrival_s: float


class CanLine:
    """One connection to a CAN bus; `address` is `socketcand://host:port/channel`."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._clock = place.clock
        parts = urlsplit(place.address)
        if parts.scheme != "socketcand" or parts.port is None or not parts.path.strip("/"):
            raise InstrumentError(
                place.name,
                f"open {place.address!r}",
                "this is no CAN address",
                "write socketcand://host:port/channel in the bench file",
            )
        self._wire = place.clock.wire(f"{parts.hostname}:{parts.port}")
        self._frames: deque[Frame] = deque()
        self._frames_lock = Lock()
        self._closing = Event()
        self._dead: str | None = None
        # python-can's own log says every refused connection again, in its own words.
        logging.getLogger("can").setLevel(logging.CRITICAL)
        try:
            # python-can would try a refused connection for ten seconds.
            address = (str(parts.hostname), parts.port)
            socket.create_connection(address, CONNECT_DEADLINE_S).close()
            self._bus: Any = can.Bus(
                interface="socketcand",
                host=parts.hostname,
                port=parts.port,
                channel=parts.path.strip("/"),
            )
        except (OSError, can.CanError) as error:
            raise InstrumentError(
                place.name,
                f"open {place.address}",
                f"nobody answers there ({error})",
                "start socketcand, check the adapter and the address in the bench file",
            ) from error
        self._wire.open()
        self._reader = Thread(target=self._read, name=f"{place.name} reader", daemon=True)
        self._reader.start()

    def send(self, identifier: int, data: bytes) -> None:
        """Put a frame on the bus."""
        message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
        self._wire.sent(1)
        try:
            self._bus.send(message)
        except (OSError, can.CanError) as error:
            raise self._broken(str(error)) from error

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

    def wait_for(self, identifier: int, deadline_s: float) -> list[Frame]:
        """Return the frames of `identifier` as soon as there are any, or none at run time."""
        while not (frames := self.take(identifier)) and self._clock.now() < deadline_s:
            self._clock.sleep(LOOK_S)
        return frames

    def close(self) -> None:
        """Close the connection and end the reader."""
        self._closing.set()
        self._wire.close()
        self._reader.join(2 * READ_SLICE_S)
        self._bus.shutdown()

    def _read(self) -> None:
        empty = 0
        while not self._closing.is_set():
            try:
                message = self._bus.recv(READ_SLICE_S)
            except (OSError, ValueError, can.CanError) as error:
                self._dead = str(error)
                return
            if message is None:
                # A closed connection reads as "nothing" at once and for ever.
                empty += 1
                if empty > EMPTY_READS_OF_A_DEAD_LINE:
                    self._dead = "the connection was closed"
                    return
                continue
            empty = 0
            frame = Frame(message.arbitration_id, bytes(message.data), self._clock.now())
            with self._frames_lock:
                self._frames.append(frame)
            self._wire.picked_up(1)

    def _broken(self, why: str) -> InstrumentError:
        return InstrumentError(
            self._place.name,
            "used the CAN bus",
            f"the line broke ({why})",
            "check the adapter, its cable and socketcand, then start again",
        )
