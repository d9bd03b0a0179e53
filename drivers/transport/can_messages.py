"""The messages of one instrument on a CAN bus, as a message file of `config/dbc` describes them.

An output may be several messages that bear the same counter in their first 16 bits and follow one
another. One of which a message is lost is no output; its number is missing in the record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from threading import Lock
from typing import Any, NamedTuple

import cantools

from drivers.transport.can_line import CanLine, Frame
from station.errors import InstrumentError
from station.roles import Place

Decoder = Callable[[bytes], tuple[float, ...]]
COUNTER_BYTES = 2


class Parts(NamedTuple):
    """The messages of one output, in their order, and when the last one had come, s.

    The values of each message's signals are in the order of `CanMessages.signals`.
    """

    values: tuple[tuple[float, ...], ...]
    arrival_s: float


@lru_cache
def message_file(name: str) -> Any:
    """Return a parsed message file of `config/dbc`."""
    text = (files("config") / "dbc" / f"{name}.dbc").read_text(encoding="utf-8")
    return cantools.database.load_string(text, database_format="dbc")


def decoder_of(message: Any) -> Decoder:
    """Return what decodes the data of a message to its signals' values, in the file's order.

    It reads the message file's own bits, signs and factors, for signals in Intel order, an order
    of magnitude faster than the library does: a long run has hundreds of thousands of messages. Of
    multiplexed signals all are decoded.
    """
    signals = [
        (
            signal.start,
            (1 << signal.length) - 1,
            signal.is_signed * (1 << signal.length - 1),
            signal.scale,
        )
        for signal in message.signals
    ]

    def decode(data: bytes) -> tuple[float, ...]:
        whole = int.from_bytes(data, "little")
        return tuple(
            # Adding and taking off the sign's bit extends the sign of a signed signal.
            ((((whole >> start) & mask) ^ sign) - sign) * scale
            for start, mask, sign, scale in signals
        )

    return decode


@lru_cache
def single_decoder(dbc: str, name: str) -> tuple[int, Decoder]:
    """Return how long a message of a file is, and what decodes it."""
    message = message_file(dbc).get_message_by_name(name)
    return int(message.length), decoder_of(message)


class CanMessages:
    """One instrument's messages: `answers` by kind, and those of an `output` in their order."""

    def __init__(
        self, place: Place, dbc: str, answers: Mapping[str, str], output: Sequence[str]
    ) -> None:
        self._place, self._dbc, self._answers = place, dbc, answers
        self._messages = message_file(dbc)
        names = {message.frame_id: message.name for message in self._messages.messages}
        self._line = CanLine(place, names)
        parts = [self._messages.get_message_by_name(name) for name in output]
        self.signals = [[signal.name for signal in part.signals] for part in parts]
        self._output = {int(part.frame_id): k for k, part in enumerate(parts)}
        self._lengths = [int(part.length) for part in parts]
        self._decoders = [decoder_of(part) for part in parts]
        self._collecting = Lock()
        self._begun: list[Frame] = []
        self._complete: list[Parts] = []

    def send(self, name: str, values: Mapping[str, Any]) -> None:
        """Put a message on the bus."""
        message = self._messages.get_message_by_name(name)
        self._line.send(message.frame_id, message.encode(values))

    def take(self, answer: str) -> Sequence[Mapping[str, Any]]:
        """Return the answers of a kind that have come."""
        return [self._decode(frame) for frame in self._line.take(self._id(answer))]

    def wait_for(self, answer: str, deadline_s: float) -> Sequence[Mapping[str, Any]]:
        """Return the answers of a kind as soon as there are any, or none at run time."""
        return [self._decode(frame) for frame in self._line.wait_for(self._id(answer), deadline_s)]

    def outputs(self) -> list[Parts]:
        """Return the complete outputs that came since the last call."""
        with self._collecting:
            self._collect()
            complete, self._complete = self._complete, []
        return complete

    def newest(self) -> Parts | None:
        """Return the last complete output that nobody has taken yet, and keep it."""
        with self._collecting:
            self._collect()
            return self._complete[-1] if self._complete else None

    def take_single(self, name: str) -> list[Parts]:
        """Return the outputs that came since the last call, each of one message of a name."""
        return [self._single(name, frame) for frame in self._line.take(self._frame_id(name))]

    def newest_single(self, name: str) -> Parts | None:
        """Return the last output of one message of a name that nobody has taken yet; keep it."""
        newest = self._line.newest(self._frame_id(name))
        return None if newest is None else self._single(name, newest)

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def _single(self, name: str, frame: Frame) -> Parts:
        length, decode = single_decoder(self._dbc, name)
        if len(frame.data) != length:
            raise self._odd(frame)
        return Parts((decode(frame.data),), frame.arrival_s)

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
            elif len(self._begun) == part and self._counter(frame) == self._counter(self._begun[0]):
                self._begun.append(frame)
                if len(self._begun) == len(self._output):
                    self._complete.append(self._put_together(self._begun))
                    self._begun = []
            else:
                self._begun = []

    def _counter(self, frame: Frame) -> bytes:
        return frame.data[:COUNTER_BYTES]

    def _put_together(self, frames: Sequence[Frame]) -> Parts:
        decoded = (decode(frame.data) for decode, frame in zip(self._decoders, frames, strict=True))
        return Parts(tuple(decoded), frames[-1].arrival_s)

    def _id(self, answer: str) -> int:
        return self._frame_id(self._answers[answer])

    def _frame_id(self, name: str) -> int:
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
            f"check that its firmware and config/dbc/{self._dbc}.dbc belong together",
        )
