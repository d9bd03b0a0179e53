"""CAN frames through python-can: a reader thread that stamps, and requests with a reply frame."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import urlsplit

import can

from drivers.transport.kept_frames import READ_SLICE_S, KeptFrames
from drivers.transport.serial_port import one_line
from drivers.transport.socketcand import Socketcand
from station.roles import Place

LONGEST_TRACE = 80


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
        try:
            self._bus = Socketcand(parts.hostname, parts.port, channel, self._passed_over)
        except OSError as error:
            raise self._nobody_answers(
                one_line(error), "start socketcand, check the adapter"
            ) from error
        self._begin_to_read()

    def send(self, identifier: int, data: bytes) -> None:
        """Put a frame on the bus."""
        self._traced_frame(">", identifier, data)
        self._wire.sent(1)
        try:
            message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            self._bus.send(message)
        except OSError as error:
            raise self._broken(one_line(error)) from error

    def close(self) -> None:
        """Close the connection and end the reader."""
        self._end_reading(2 * READ_SLICE_S)
        with suppress(OSError):
            self._bus.shutdown()

    def _read(self, within_s: float) -> bool:
        try:
            messages = self._received(within_s)
        except (OSError, ValueError) as error:
            if not self._closing.is_set():
                self._dead = one_line(error)
            # Nothing that is still on its way can come any more.
            self._wire.close()
            return False
        arrival_s, frames = self._clock.now(), []
        for message in messages:
            identifier, data = message.arbitration_id, bytes(message.data)
            if message.is_error_frame:
                self._traced("!", f"error frame {identifier:X}".encode())
                continue
            self._traced_frame("<", identifier, data)
            if identifier in self._names:
                frames.append(Frame(identifier, data, arrival_s))
        self._keep(frames)
        self._wire.picked_up(sum(not one.is_error_frame for one in messages))
        return bool(messages)

    def _received(self, within_s: float) -> list[can.Message]:
        """Return all messages that have come, or the first that come within a real time."""
        message = self._bus.recv(within_s)
        messages = [] if message is None else [message]
        while self._bus.waiting:
            messages.append(self._bus.recv(0.0))
        return messages

    def _passed_over(self, data: bytes) -> None:
        self._traced("!", data[:LONGEST_TRACE] + b": no message of socketcand")

    def _traced_frame(self, direction: str, identifier: int, data: bytes) -> None:
        if self._trace is not None:
            name = self._names.get(identifier, "")
            said = f"{identifier:03X}#{data.hex().upper()} {name}".rstrip()
            self._trace(direction, said.encode())
