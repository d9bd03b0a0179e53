"""Binary frames that an instrument sends unasked, over a serial port or the TCP port of one."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.transport.kept_frames import KeptFrames
from drivers.transport.ports import Port, SerialSettings, open_port, wire_address
from station.errors import reason_of
from station.roles import Place

MAX_FRAME = 1 << 16


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

    `split` knows the instrument's frames. Bytes that belong to none are passed over and go to
    the trace: whoever counts frames sees what is missing.
    """

    def __init__(self, place: Place, framing: SerialSettings, split: Splitter) -> None:
        super().__init__(place, wire_address(place.address), lambda frame: frame.kind)
        self._split = split
        self._pending = b""
        try:
            self._port: Port = self._wire.port() or open_port(place.address, framing)
        except (OSError, ValueError) as error:
            raise self._not_opened(error) from error
        self._begin_to_read()

    def send(self, data: bytes) -> None:
        """Put bytes on the line."""
        self._traced(">", data)
        self._wire.sent(len(data))
        try:
            self._port.write(data)
        except OSError as error:
            raise self._broken(reason_of(error)) from error

    def _shut(self) -> None:
        self._port.close()

    def _read(self, within_s: float) -> bool:
        try:
            data = self._port.read(within_s)
        except (OSError, ValueError, TypeError) as error:  # pyserial on a port that vanished
            return self._died(error)
        if not data:
            return False
        self._traced("<", data)
        split = self._split(self._pending + data)
        # The beginning of a frame is short; bytes without end must not be kept.
        self._pending = split.rest[-MAX_FRAME:]
        arrival_s = self._clock.now()
        self._keep(StreamFrame(kind, payload, arrival_s) for kind, payload in split.frames)
        if split.skipped:
            self._traced("!", f"{split.skipped} bytes that belong to no frame".encode())
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
        return [self._decoded(frame) for frame in self._stream.take(self._kinds[answer])]

    def wait_for(self, answer: str, deadline_s: float) -> list[Mapping[str, Any]]:
        """Return the answers of a kind as soon as there are any, or none at run time."""
        frames = self._stream.wait_for(self._kinds[answer], deadline_s)
        return [self._decoded(frame) for frame in frames]


REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
ALL_ONES = 0xFFFFFFFF


def crc32_mpeg2(data: bytes) -> int:
    """Return the CRC-32 of polynomial 0x04C11DB7 from all ones, most significant bit first.

    Neither input nor result is reflected, and nothing is XORed at the end. The library's CRC is the
    same one reflected: so are its input and its result here.
    """
    reflected = zlib.crc32(data.translate(REVERSED)) ^ ALL_ONES
    return int.from_bytes(reflected.to_bytes(4, "little").translate(REVERSED), "big")


def crc32_stim300(data: bytes) -> int:
    """Return the CRC-32 of STIM300: that of MPEG-2 over zero bytes, too, that are not sent.

    They fill up to a multiple of four (TS1524, table 5-22).
    """
    return crc32_mpeg2(data + bytes(-len(data) % 4))


def ends_with_its_crc(data: bytes) -> bool:
    """Return whether the last four bytes are the CRC of those before, most significant first.

    The CRC of all of them is zero then.
    """
    return zlib.crc32(data.translate(REVERSED)) == ALL_ONES


LATE_BY = 32
"""A frame that is at most so many behind the newest comes late, or twice."""

Numbers = NDArray[np.int64]
Kept = NDArray[np.bool_]
Counting = Callable[[NDArray[np.uint8], NDArray[np.float64]], tuple[Numbers, Kept]]


class Numbering:
    """Number frames from 1, whose own number goes from 0 to `modulus` - 1 and begins again.

    What a gap of `modulus` frames and more swallowed shows by when the next ones came. Arrivals
    are late by chance, never early: only a delay that none of a block's later frames makes up for
    is a gap.
    """

    def __init__(self, interval_s: float, modulus: int) -> None:
        self._interval_s = interval_s
        self._modulus = modulus
        self._sequence: int | None = None
        self._number = 0
        self._expected_s = 0.0
        """When the last number was due, by the least late of the last block."""

    def numbers(
        self, sequence: NDArray[np.uint8], arrival_s: NDArray[np.float64]
    ) -> tuple[Numbers, Kept]:
        """Return the frames' numbers, and which of them are new, shape (frames,) each."""
        if not len(sequence):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
        if self._sequence is None:
            self._sequence = (int(sequence[0]) - 1) % self._modulus
            self._expected_s = float(arrival_s[0]) - self._interval_s
        steps, kept = self._steps(sequence)
        number = self._number + np.cumsum(steps)
        expected_s = self._expected_s + (number - self._number) * self._interval_s
        late_s = (arrival_s - expected_s)[kept]
        lost = np.zeros(len(sequence), dtype=np.int64)
        if len(late_s):
            surely_s = np.minimum.accumulate(late_s[::-1])[::-1]
            around_s = self._modulus * self._interval_s
            rounds = np.floor(np.maximum(surely_s, 0.0) / around_s + 0.5).astype(np.int64)
            lost[kept] = self._modulus * np.maximum.accumulate(rounds)
            lost = np.maximum.accumulate(lost)
            least_s = float(np.min(late_s - lost[kept] * self._interval_s))
            gone = int(number[-1] + lost[-1]) - self._number
            self._expected_s += gone * self._interval_s + least_s
            number = number + lost
            self._number += gone
            self._sequence = int(sequence[kept][-1])
        return number, kept

    def looked_at(
        self, sequence: NDArray[np.uint8], arrival_s: NDArray[np.float64]
    ) -> tuple[Numbers, Kept]:
        """Return no numbers for frames that somebody will take later."""
        return np.zeros(len(sequence), dtype=np.int64), np.ones(len(sequence), dtype=np.bool_)

    def _steps(self, sequence: NDArray[np.uint8]) -> tuple[Numbers, Kept]:
        """Return by how many each frame is after the newest one before it; 0 for one left out."""
        assert self._sequence is not None
        before = np.concatenate(([self._sequence], sequence[:-1].astype(np.int64)))
        steps = (sequence.astype(np.int64) - before) % self._modulus
        kept = np.ones(len(sequence), dtype=np.bool_)
        if bool(((steps == 0) | (steps >= self._modulus - LATE_BY)).any()):
            newest = self._sequence
            for k, number in enumerate(sequence.tolist()):
                step = (number - newest) % self._modulus
                kept[k] = 0 < step < self._modulus - LATE_BY
                steps[k] = step if kept[k] else 0
                newest = number if kept[k] else newest
        return steps, kept
