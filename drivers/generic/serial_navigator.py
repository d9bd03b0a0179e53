"""The fibre-optic navigator on RS-422, in frames of our own.

115200 Bd, 8 data bits, no parity, one stop bit unless the bench file says otherwise. Every number
has its most significant byte first. A frame:

| bytes | content |
|---|---|
| 2 | sync, 9A 65 |
| 1 | kind |
| 1 | length of the payload in bytes |
| length | payload |
| 4 | CRC-32 of all before it, filled up with zero bytes that are not sent to a multiple of four |

The CRC is that of STIM300: polynomial 0x04C11DB7, seed 0xFFFFFFFF, not reflected, no final XOR.

Kind 10, to the navigator, a command: command (1 byte: 1 start, 2 stop, 3 identify, 4 report status,
5 align), request number (2), argument (4, signed: with start the rate in 0.1 Hz, with align the
latitude in 1e-7 deg, else 0).

Kind 90, an output: counter (2; 1 for the first after a start, modulo 65536), heading (4, unsigned,
1e-7 deg), pitch and roll (4 each, signed, 1e-7 deg), temperature of the gyros x, y, z (2 each,
signed, 0.01 degC; -327.68 degC means no sensor), status (2).

Kind 91, what became of a command: command (1), result (1: 0 ok, 1 unknown command, 2 bad rate,
3 bad latitude, 4 already running, 5 bad length, 6 unit off), request number (2), rate in force (1,
0.1 Hz, 0 while nothing is output).

Kind 92, after the acknowledgement of a report: status (2), alignment under way for (2, 0.1 s),
counter of the last output (2), rate in force (1, 0.1 Hz).

Kind 93, after the acknowledgement of identify: serial number (4), firmware major and minor,
hardware revision, protocol version (1 each).

Status: bit 0 aligned, 1 aligning; faults: bit 8 unit off, 9 alignment failed, 10 a gyro failed its
own test. The interface has a supply of its own and answers while the unit behind it is off.

Commands and their sources:
    10 - a command - the frames in its docstring - confirmed
    90, 91, 92, 93 - an output, and what became of a command - this project's frames, above -
        confirmed
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, ClassVar

from drivers.generic.navigator import COMMANDS, RESULTS, InertialNavigator, Output
from drivers.transport.ports import BaudRate, SerialSettings
from drivers.transport.serial_stream import (
    SerialStream,
    Split,
    StreamAnswers,
    StreamFrame,
    crc32_stim300,
)
from station.roles import Place

SYNC = b"\x9a\x65"
MAX_PAYLOAD = 32
COMMAND, OUTPUT, ACKNOWLEDGEMENT, STATUS, IDENTITY = 0x10, 0x90, 0x91, 0x92, 0x93

HEAD = struct.Struct(">2sBB")
CHECKSUM = struct.Struct(">I")
COMMAND_PAYLOAD = struct.Struct(">BHi")
PAYLOADS = {
    OUTPUT: struct.Struct(">HIii3hH"),
    ACKNOWLEDGEMENT: struct.Struct(">BBHB"),
    STATUS: struct.Struct(">HHHB"),
    IDENTITY: struct.Struct(">I4B"),
}


def frame(kind: int, payload: bytes) -> bytes:
    """Return a whole frame."""
    data = HEAD.pack(SYNC, kind, len(payload)) + payload
    return data + CHECKSUM.pack(crc32_stim300(data))


def split(pending: bytes) -> Split:
    """Return the frames that bytes hold; after a wrong checksum the next sync bytes are looked for.

    A frame with the length of none, or of a kind whose payload has another, counts as damaged.
    """
    frames: list[tuple[int, bytes]] = []
    position, skipped = 0, 0
    while True:
        begin = pending.find(SYNC, position)
        if begin < 0:
            # The last byte may be the first of a sync.
            end = len(pending) - (pending[-1:] == SYNC[:1] and position < len(pending))
            return Split(frames, pending[end:], skipped + end - position)
        skipped += begin - position
        if len(pending) < begin + HEAD.size:
            return Split(frames, pending[begin:], skipped)
        _, kind, length = HEAD.unpack_from(pending, begin)
        end = begin + HEAD.size + length + CHECKSUM.size
        if length <= MAX_PAYLOAD:
            if len(pending) < end:
                return Split(frames, pending[begin:], skipped)
            body = pending[begin : end - CHECKSUM.size]
            right = crc32_stim300(body) == CHECKSUM.unpack_from(pending, end - CHECKSUM.size)[0]
            if right and kind in PAYLOADS and PAYLOADS[kind].size == length:
                frames.append((kind, body[HEAD.size :]))
                position = end
                continue
        skipped += 1
        position = begin + 1


ANGLE_DEG, RATE_HZ, TEMPERATURE_DEGC, TIME_S = 1e-7, 0.1, 0.01, 0.1
ANSWERS: Mapping[str, int] = {
    "acknowledgement": ACKNOWLEDGEMENT,
    "status": STATUS,
    "identity": IDENTITY,
}


class SerialNavigator(InertialNavigator):
    """A navigator that outputs heading, attitude and the temperatures of its gyros on RS-422."""

    class Settings(SerialSettings):
        """Its line."""

        baud_rate: BaudRate = 115200

    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask `identify`; it knows no `*IDN?`."""

    def __init__(self, place: Place) -> None:
        self._line = SerialStream(place, self.Settings.of(place), split)
        super().__init__(place, StreamAnswers(self._line, ANSWERS, decoded))

    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        steps = values.get("rate_Hz", 0.0) / RATE_HZ + values.get("latitude_deg", 0.0) / ANGLE_DEG
        payload = COMMAND_PAYLOAD.pack(COMMANDS[command], number, round(steps))
        self._line.send(frame(COMMAND, payload))

    def _outputs(self) -> list[Output]:
        return [output(frame) for frame in self._line.take(OUTPUT)]

    def _newest(self) -> Output | None:
        newest = self._line.newest(OUTPUT)
        return None if newest is None else output(newest)


def output(received: StreamFrame) -> Output:
    """Return an output in its units."""
    counter, heading, pitch, roll, x, y, z, status = PAYLOADS[OUTPUT].unpack(received.payload)
    return Output(
        counter,
        heading * ANGLE_DEG,
        pitch * ANGLE_DEG,
        roll * ANGLE_DEG,
        x * TEMPERATURE_DEGC,
        y * TEMPERATURE_DEGC,
        z * TEMPERATURE_DEGC,
        status,
        received.arrival_s,
    )


def decoded(received: StreamFrame) -> Mapping[str, Any]:
    """Return an answer by names."""
    values = PAYLOADS[received.kind].unpack(received.payload)
    if received.kind == ACKNOWLEDGEMENT:
        _, result, request, rate = values
        word = RESULTS[result] if result < len(RESULTS) else f"result {result}"
        return {"request_id": request, "result": word, "rate": rate * RATE_HZ}
    if received.kind == STATUS:
        status, aligning, _, _ = values
        return {"status": status, "aligning_for": aligning * TIME_S}
    serial, major, minor, _, _ = values
    return {"serial_number": serial, "firmware_major": major, "firmware_minor": minor}
