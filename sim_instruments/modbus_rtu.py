"""A Modbus RTU device on a serial line, which is served on a TCP port.

From the serial line guide V1.02 of the Modbus organisation: unit, request, CRC-16 with its low byte
first; a silence ends a frame. What has a wrong check sum, or is meant for another unit, stays
without an answer; what is meant for all (unit 0) is carried out without one.
"""

from __future__ import annotations

import socket
import struct

from sim_instruments.instrument import Setting
from sim_instruments.modbus import (
    READ_HOLDING,
    READ_INPUT,
    WRITE_MANY,
    WRITE_ONE,
    ModbusServer,
    Registers,
)

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

    def serve(self, client: socket.socket) -> None:
        """Read frames until the client leaves."""
        pending, free_s, heard_s = b"", 0.0, 0.0
        while data := client.recv(65536):
            with self._wire.serving(len(data)):
                if client in self._dropped:
                    self._wire.answered(1)
                    continue
                now_s = self._clock.now()
                if now_s > heard_s + SILENCE_S:
                    pending = b""
                pending, heard_s = pending + data, now_s
                while (size := frame_size(pending)) and len(pending) >= size:
                    frame, pending = pending[:size], pending[size:]
                    if crc16(frame) == 0:
                        free_s = self._answer(client, frame, free_s)
                    else:
                        pending = b""

    def _frame(self, frame: bytes) -> bytes:
        if frame[0] not in (self._unit, EVERYBODY):
            return b""
        answer = bytes([self._unit]) + self._registers.answer(frame[1:-2])
        return b"" if frame[0] == EVERYBODY else answer + struct.pack("<H", crc16(answer))


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
