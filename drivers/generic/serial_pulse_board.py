"""A laser-gyro pulse board on RS-422 that outputs in the datagrams of a STIM300, 0x94.

921600 Bd, 8 data bits, no parity, one stop bit unless the bench file says otherwise. The board is
house-made. From the data sheet of STIM300 (TS1524): identifier, three values of 24 bits and their
status, three temperatures of 16 bits in 2^-8 degC and their status, counter, latency, checksum;
every number is signed unless said, its most significant byte first; an identifier tells how long
its datagram is. The checksum is a CRC-32 (polynomial 0x04C11DB7, seed 0xFFFFFFFF, not reflected,
no final XOR) over everything before it, filled up with zero bytes that are not sent to a multiple
of four: three of them with 0x94. What is the board's own stands below.

| identifier | bytes | content |
|---|---|---|
| 94, output | 3 x 3 | pulses of channels 1, 2, 3 since the start, modulo 2^24 |
| | 1 | status: bits 0, 1, 2 set while channel 1, 2, 3 has no lit gyro |
| | 3 x 2 | temperature of the gyros |
| | 1 | status: bits 0, 1, 2 set where there is no sensor |
| | 1 | counter of the sample interval, unsigned; 1 for the first after a start, modulo 256 |
| | 2 | latency, unsigned, in us: from the interval's end to the datagram's first bit |
| 60, to the board | 1, 1 | command (1 start, 2 stop, 3 identify, 4 status); bits of channels |
| | 4, 2 | sample interval in 0.1 ms, unsigned; number of the request |
| 61, what became of it | 1, 1 | command; 0 ok, 1 unknown command, 2 bad interval, 3 bad channels, \
4 already running, 5 bad length |
| | 2, 4 | number of the request; sample interval in force |
| 62, after a 61 to 4 | 4 | samples since the start |
| | 4 x 1 | running, errors, bits of the gyros that are there, of those that are lit |
| 63, after a 61 to 3 | 4 | serial number |
| | 4 x 1 | firmware major and minor, hardware revision, channels |

A STIM300 counts its own samples of 2000 Hz in its counter, this board those that it outputs.

Commands and their sources:
    94 - an output - data sheet of STIM300, TS1524 - confirmed
    60 - a command - the frames in its docstring - confirmed
    61, 62, 63 - what became of a command, status, identity - this project's frames, above -
        confirmed
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from drivers.generic.pulse_board import PulseBoard, Sample
from drivers.transport.ports import BaudRate, SerialSettings
from drivers.transport.serial_stream import (
    Numbering,
    SerialStream,
    Split,
    StreamAnswers,
    StreamFrame,
    crc32_stim300,
)
from station.roles import Place

COMMAND, OUTPUT, ACKNOWLEDGEMENT, STATUS, IDENTITY = 0x60, 0x94, 0x61, 0x62, 0x63
CHECKSUM = struct.Struct(">I")
COMMAND_PAYLOAD = struct.Struct(">BBIH")
PAYLOADS = {
    OUTPUT: struct.Struct(">3s3s3sB3hBBH"),
    ACKNOWLEDGEMENT: struct.Struct(">BBHI"),
    STATUS: struct.Struct(">I4B"),
    IDENTITY: struct.Struct(">I4B"),
}
LENGTHS = {kind: 1 + payload.size + CHECKSUM.size for kind, payload in PAYLOADS.items()}


def frame(kind: int, payload: bytes) -> bytes:
    """Return a whole datagram."""
    data = bytes((kind,)) + payload
    return data + CHECKSUM.pack(crc32_stim300(data))


def split(pending: bytes) -> Split:
    """Return the datagrams that bytes hold.

    There are no sync bytes: a datagram is where an identifier, its length and the right checksum
    come together. What may be the beginning of one is kept, unless a whole one follows it.
    """
    frames: list[tuple[int, bytes]] = []
    position = taken = skipped = 0
    begun: int | None = None
    while position < len(pending):
        kind = pending[position]
        end = position + LENGTHS.get(kind, 0)
        if end > len(pending) and begun is None:
            begun = position
        if position < end <= len(pending):
            body = pending[position : end - CHECKSUM.size]
            if CHECKSUM.unpack_from(pending, end - CHECKSUM.size)[0] == crc32_stim300(body):
                frames.append((kind, body[1:]))
                skipped += position - taken
                position = taken = end
                begun = None
                continue
        position += 1
    end = len(pending) if begun is None else begun
    return Split(frames, pending[end:], skipped + end - taken)


COMMANDS: Mapping[str, int] = {"start": 1, "stop": 2, "identify": 3, "status": 4}
RESULTS = (
    "ok",
    "unknown_command",
    "bad_interval",
    "bad_channel_mask",
    "already_running",
    "bad_length",
)
ANSWERS: Mapping[str, int] = {
    "acknowledgement": ACKNOWLEDGEMENT,
    "status": STATUS,
    "identity": IDENTITY,
}
INTERVAL_S, TEMPERATURE_DEGC, LATENCY_S = 1e-4, 2.0**-8, 1e-6
COUNTER_MODULUS, COUNTS_MODULUS, SHOWN_MODULUS = 2**8, 2**24, 2**32


class SerialPulseBoard(PulseBoard):
    """A board that counts the pulses of up to three laser gyros, on RS-422.

    Its numbers are continued beyond their few bits: the counter to 16, by the arrivals where whole
    rounds of it are lost, and the pulses to 32.
    """

    class Settings(SerialSettings):
        """Its line."""

        baud_rate: BaudRate = 921600

    model = "serial pulse board"
    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask `identify`; it knows no `*IDN?`."""
    further: ClassVar[Mapping[str, str]] = {
        "latency_s": "s from the end of the interval to the first bit of its datagram"
    }

    def __init__(self, place: Place) -> None:
        self._line = SerialStream(place, self.Settings.of(place), split)
        self._read_channel = 1
        self._numbering = Numbering(1.0, COUNTER_MODULUS)
        self._raw_counts = self._counts = 0
        super().__init__(place, StreamAnswers(self._line, ANSWERS, decoded))

    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        steps = round(values.get("sample_interval_s", 0.0) / INTERVAL_S)
        mask = int(values.get("channel_mask", 0))
        payload = COMMAND_PAYLOAD.pack(COMMANDS[command], mask, steps, number)
        self._line.send(frame(COMMAND, payload))

    def _begin(self, channel: int, sample_interval_s: float) -> None:
        self._read_channel = channel
        self._numbering = Numbering(sample_interval_s, COUNTER_MODULUS)
        self._raw_counts = self._counts = 0
        self._line.take(OUTPUT)

    def _samples(self) -> Sequence[Sample]:
        """Return the samples that came since the last call; one that came twice is left out."""
        frames = self._line.take(OUTPUT)
        outputs = [output(frame, self._read_channel) for frame in frames]
        numbers, new = self._numbering.numbers(
            np.array([output.sequence for output in outputs], dtype=np.uint8),
            np.array([output.arrival_s for output in outputs], dtype=np.float64),
        )
        return [
            output._replace(sequence=int(number) & 0xFFFF, counts=self._continued(output.counts))
            for output, number, is_new in zip(outputs, numbers, new, strict=True)
            if is_new
        ]

    def _newest(self) -> Sample | None:
        """Return the last sample that nobody has taken yet, by its own numbers."""
        newest = self._line.newest(OUTPUT)
        return None if newest is None else output(newest, self._read_channel)

    def _continued(self, raw: int) -> int:
        """Return pulses of 24 bits continued to 32; between two samples come less than 2^23."""
        self._counts += wrapped(raw - self._raw_counts, COUNTS_MODULUS)
        self._raw_counts = raw
        return wrapped(self._counts, SHOWN_MODULUS)


def wrapped(value: int, modulus: int) -> int:
    """Return a number within half a modulus of zero."""
    return (value + modulus // 2) % modulus - modulus // 2


def output(received: StreamFrame, channel: int) -> Sample:
    """Return what an output says of a channel."""
    values = PAYLOADS[OUTPUT].unpack(received.payload)
    k = channel - 1
    counts, dark, degC, missing = values[k], values[3], values[4 + k], values[7]
    counter, latency = values[8:]
    return Sample(
        counter,
        int.from_bytes(counts, "big", signed=True),
        math.nan if missing >> k & 1 else degC * TEMPERATURE_DEGC,
        not dark >> k & 1,
        received.arrival_s,
        (latency * LATENCY_S,),
    )


def decoded(received: StreamFrame) -> Mapping[str, Any]:
    """Return an answer by names."""
    values = PAYLOADS[received.kind].unpack(received.payload)
    if received.kind == ACKNOWLEDGEMENT:
        _, result, request, _ = values
        word = RESULTS[result] if result < len(RESULTS) else f"result {result}"
        return {"request_id": request, "result": word}
    if received.kind == STATUS:
        return {"gyro_present": values[3], "laser_on": values[4]}
    return dict(zip(("serial_number", "firmware_major", "firmware_minor"), values[:3], strict=True))
