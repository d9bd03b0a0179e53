"""The fibre-optic navigator on CAN, decoded by its message file `config/dbc/navigator.dbc`.

An output is three messages that bear the same counter and follow one another: `NAV_HEADING`
(counter, heading, pitch), `NAV_ROLL` (counter, roll, status) and `NAV_TEMPERATURES` (counter, the
three gyros). One of which a message is lost is no output; its number is missing in the record.
Angles are in steps of 0.0001 deg, temperatures of 0.01 degC.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from threading import Lock
from typing import Any, ClassVar

import cantools

from drivers.navigator import InertialNavigator
from drivers.navigator_messages import Output, Request
from drivers.roles import Place
from drivers.transport.can_line import CanLine, Frame
from station.errors import InstrumentError

ANSWERS: Mapping[str, str] = {
    "acknowledgement": "NAV_ACK",
    "status": "NAV_STATUS",
    "identity": "NAV_IDENTITY",
}
OUTPUT = ("NAV_HEADING", "NAV_ROLL", "NAV_TEMPERATURES")
"""The messages of an output, in the order in which they come."""

Decoder = Callable[[bytes], tuple[float, ...]]


@lru_cache
def message_file() -> Any:
    """Return the parsed DBC of the navigator."""
    text = (files("config") / "dbc" / "navigator.dbc").read_text(encoding="utf-8")
    return cantools.database.load_string(text, database_format="dbc")


def decoder_of(message: Any) -> Decoder:
    """Return what decodes the data of a message to its signals' values, in the file's order.

    It reads the message file's own bits, signs and factors, for signals in Intel order, an order
    of magnitude faster than the library does: a long run has hundreds of thousands of messages.
    """
    signals = [
        (one.start, (1 << one.length) - 1, one.is_signed * (1 << one.length - 1), one.scale)
        for one in message.signals
    ]

    def decode(data: bytes) -> tuple[float, ...]:
        whole = int.from_bytes(data, "little")
        return tuple(
            # Adding and taking off the sign's bit extends the sign of a signed signal.
            ((((whole >> start) & mask) ^ sign) - sign) * scale
            for start, mask, sign, scale in signals
        )

    return decode


class CanNavigatorLine:
    """The navigator's messages on a CAN bus."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._messages = message_file()
        names = {one.frame_id: one.name for one in self._messages.messages}
        self._line = CanLine(place, names)
        self._output = {self._id(name): k for k, name in enumerate(OUTPUT)}
        parts = [self._messages.get_message_by_name(name) for name in OUTPUT]
        self._lengths = [int(one.length) for one in parts]
        self._decoders = [decoder_of(one) for one in parts]
        self._collecting = Lock()
        self._begun: list[Frame] = []
        self._complete: list[Output] = []

    def send(self, request: Request) -> None:
        """Put a command on the bus."""
        message = self._messages.get_message_by_name("NAV_COMMAND")
        data = message.encode(
            {
                "command": request.command,
                "rate": request.rate_Hz,
                "request_id": request.number,
                "latitude": request.latitude_deg,
            }
        )
        self._line.send(message.frame_id, data)

    def take(self, answer: str) -> Sequence[Mapping[str, Any]]:
        """Return the answers of a kind that have come."""
        return [self._decode(one) for one in self._line.take(self._id(ANSWERS[answer]))]

    def wait_for(self, answer: str, deadline_s: float) -> Sequence[Mapping[str, Any]]:
        """Return the answers of a kind as soon as there are any, or none at run time."""
        frames = self._line.wait_for(self._id(ANSWERS[answer]), deadline_s)
        return [self._decode(one) for one in frames]

    def outputs(self) -> list[Output]:
        """Return the complete outputs that came since the last call."""
        with self._collecting:
            self._collect()
            found, self._complete = self._complete, []
        return found

    def newest(self) -> Output | None:
        """Return the last complete output that nobody has taken yet, and keep it."""
        with self._collecting:
            self._collect()
            return self._complete[-1] if self._complete else None

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def _collect(self) -> None:
        """Put the messages of outputs together; a part that does not follow begins anew."""
        try:
            frames = self._line.take(*self._output)
        except InstrumentError:
            if self._complete:  # first what had come, at the next look the line that is gone
                return
            raise
        for frame in frames:
            part = self._output[frame.identifier]
            if len(frame.data) != self._lengths[part]:
                raise self._odd(frame)
            if part == 0:
                self._begun = [frame]
            elif len(self._begun) == part and self._begun[0].data[:2] == frame.data[:2]:
                self._begun.append(frame)
                if len(self._begun) == len(OUTPUT):
                    self._complete.append(self._put_together(self._begun))
                    self._begun = []
            else:
                self._begun = []

    def _put_together(self, frames: Sequence[Frame]) -> Output:
        decoded = [decode(frame.data) for decode, frame in zip(self._decoders, frames, strict=True)]
        (counter, heading, pitch), (_, roll, status), (_, x, y, z) = decoded
        arrival_s = frames[-1].arrival_s
        return Output(int(counter), heading, pitch, roll, x, y, z, int(status), arrival_s)

    def _id(self, name: str) -> int:
        return int(self._messages.get_message_by_name(name).frame_id)

    def _decode(self, frame: Frame) -> Mapping[str, Any]:
        try:
            decoded: Mapping[str, Any] = self._messages.decode_message(frame.identifier, frame.data)
        except cantools.database.DecodeError as error:
            raise self._odd(frame) from error
        return decoded

    def _odd(self, frame: Frame) -> InstrumentError:
        return InstrumentError(
            self._place.name,
            "read a frame",
            f"{frame.identifier:03X}#{frame.data.hex().upper()} is none of its messages",
            "check that the navigator's firmware and config/dbc/navigator.dbc belong together",
        )


class CanNavigator(InertialNavigator):
    """A navigator that outputs heading, attitude and the temperatures of its gyros on a CAN bus."""

    identifies_on: ClassVar[str] = "socketcand"
    """Where a scan of served instruments may ask `identify`; a bus gives no `*IDN?` to go by."""

    def __init__(self, place: Place) -> None:
        super().__init__(place, CanNavigatorLine(place))
