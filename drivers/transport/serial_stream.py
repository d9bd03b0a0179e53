"""Binary frames that an instrument sends unasked, over a serial port or the TCP port of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from drivers.transport.kept_frames import READ_SLICE_S, KeptFrames
from drivers.transport.serial_port import Port, SerialSettings, one_line, open_port, wire_address
from station.roles import Place

LONGEST_FRAME = 1 << 16


class Split(NamedTuple):
    """What is found in bytes: whole frames by kind, the beginning of one, and bytes of none."""

    frames: list[tuple[int, bytes]]
    rest: bytes
    skipped: int


Splitter = Callable[[bytes], Split]


class StreamFrame(NamedTuple):
    """A received frame: its kind, its payload and the run time at which it reached the computer."""

    kind: int
    payload: bytes
    arrival_s: float


class SerialStream(KeptFrames[StreamFrame]):
    """One instrument's line, read by a thread that stamps; frames wait until somebody takes them.

    `split` knows the instrument's frames. Bytes that belong to none are passed over and told to
    the trace: whoever counts frames sees what is missing.
    """

    def __init__(self, place: Place, framing: SerialSettings, split: Splitter) -> None:
        super().__init__(place, wire_address(place.address), lambda frame: frame.kind)
        self._split = split
        self._pending = b""
        try:
            self._port: Port = open_port(place.address, framing)
        except (OSError, ValueError) as error:
            raise self._nobody_answers(one_line(error)) from error
        self._begin_to_read()

    def send(self, data: bytes) -> None:
        """Put bytes on the line."""
        self._traced(">", data)
        self._wire.sent(len(data))
        try:
            self._port.write(data)
        except OSError as error:
            raise self._broken(one_line(error)) from error

    def close(self) -> None:
        """Close the line and end the reader; a line that is already gone is no error."""
        self._end_reading(2 * READ_SLICE_S)
        with suppress(OSError):
            self._port.close()

    def _read(self, within_s: float) -> bool:
        try:
            data = self._port.read(within_s)
        except (OSError, ValueError, TypeError) as error:  # pyserial on a port that vanished
            if not self._closing.is_set():
                self._dead = one_line(error) or type(error).__name__
            # Nothing that is still on its way can come any more.
            self._wire.close()
            return False
        if not data:
            return False
        self._traced("<", data)
        found = self._split(self._pending + data)
        # The beginning of a frame is short; bytes without end must not be kept.
        self._pending = found.rest[-LONGEST_FRAME:]
        arrival_s = self._clock.now()
        self._keep(StreamFrame(kind, payload, arrival_s) for kind, payload in found.frames)
        if found.skipped:
            self._traced("!", f"{found.skipped} bytes that belong to no frame".encode())
        self._wire.picked_up(len(data))
        return True


class StreamAnswers:
    """The answers of an instrument among the frames of its stream.

    `kinds` has the kind of frame of each answer, `decoded` gives its content by names.
    """

    def __init__(
        self,
        stream: SerialStream,
        kinds: Mapping[str, int],
        decoded: Callable[[StreamFrame], Mapping[str, Any]],
    ) -> None:
        self._stream, self._kinds, self._decoded = stream, kinds, decoded

    def take(self, answer: str) -> list[Mapping[str, Any]]:
        """Return the answers of a kind that have come."""
        return [self._decoded(one) for one in self._stream.take(self._kinds[answer])]

    def wait_for(self, answer: str, deadline_s: float) -> list[Mapping[str, Any]]:
        """Return the answers of a kind as soon as there are any, or none at run time."""
        found = self._stream.wait_for(self._kinds[answer], deadline_s)
        return [self._decoded(one) for one in found]
