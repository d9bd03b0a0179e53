"""A Modbus RTU device on a serial line, which is served on a TCP port.

From the serial line guide V1.02 of the Modbus organisation: unit, request, CRC-16 with its low byte
first; a silence ends a frame. What has a wrong check sum, or is meant for another unit, stays
without an answer; what is meant for all (unit 0) is carried out without one.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from sim_instruments.instrument import Setting
from sim_instruments.wire.modbus import (
    READ_HOLDING,
    READ_INPUT,
    WRITE_MANY,
    WRITE_ONE,
    ModbusServer,
    Registers,
)
from sim_instruments.wire.requests import Conversation

POLYNOMIAL = 0xA001
SILENCE_S = 0.02
"""What ends a frame: more than three and a half characters at 9600 Bd, and some."""

SHORTEST, FIXED, BEFORE_DATA, LONGEST = 4, 8, 7, 256
EVERYBODY = 0


class ModbusRtuServer(ModbusServer):
    """Answer for one device."""

    def __init__(self, setting: Setting, registers: Registers, unit: int) -> None:
        super().__init__(setting, registers, 1)
        self._unit = unit

    def requests(self, talk: Conversation, data: bytes) -> Iterator[bytes]:
        """Take whole frames off what has come; what a silence cut short is forgotten."""
        now_s = self._clock.now()
        if now_s > talk.heard_s + SILENCE_S:
            talk.pending = b""
        talk.pending, talk.heard_s = talk.pending + data, now_s
        while (size := frame_size(talk.pending)) and len(talk.pending) >= size:
            frame, talk.pending = talk.pending[:size], talk.pending[size:]
            if crc16(frame) == 0:
                yield frame
            else:
                talk.pending = b""

    def execute(self, request: bytes) -> bytes:
        """Return the answer to a frame, or nothing."""
        if request[0] not in (self._unit, EVERYBODY):
            return b""
        answer = bytes([self._unit]) + self._registers.answer(request[1:-2])
        return b"" if request[0] == EVERYBODY else answer + struct.pack("<H", crc16(answer))


def frame_size(pending: bytes) -> int:
    """Return how long the request that begins here is, 0 where more must come to know it."""
    if len(pending) < SHORTEST:
        return 0
    if pending[1] in (READ_HOLDING, READ_INPUT, WRITE_ONE):
        return FIXED
    if pending[1] == WRITE_MANY:
        return BEFORE_DATA + pending[6] + 2 if len(pending) >= BEFORE_DATA else 0
    # Of a function that is not known, what came at once is the frame.
    return min(len(pending), LONGEST)


def crc16(data: bytes) -> int:
    """Return the check sum of a frame; with its own check sum behind it, a frame's is zero."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ POLYNOMIAL if crc & 1 else crc >> 1
    return crc
