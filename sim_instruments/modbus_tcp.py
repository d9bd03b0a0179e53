"""A Modbus TCP server: the MBAP header, and any number of clients.

From the messaging implementation guide V1.0b of the Modbus organisation: transaction, protocol 0,
length, unit, then the request; the answer repeats the transaction and the unit. A request may
arrive in pieces. An answer goes out in one, because clients read the header by itself.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

from sim_instruments.instrument import Setting
from sim_instruments.modbus import ModbusServer, Registers

HEADER = struct.Struct(">HHHB")
LENGTHS = range(2, 255)
EVERY_UNIT = (0, 255)
"""How a client that speaks to the one device of an address may name it."""


class ModbusTcpServer(ModbusServer):
    """Answer for one device; requests to other units stay without an answer."""

    def __init__(self, setting: Setting, registers: Registers, unit: int) -> None:
        super().__init__(setting, registers, HEADER.size)
        self._units = (unit, *EVERY_UNIT)

    def serve(self, client: socket.socket) -> None:
        """Read frames until the client leaves, or sends what is none."""
        pending, free_s = bytearray(), 0.0
        while data := client.recv(65536):
            with self._wire.serving(len(data)):
                if client in self._dropped:
                    self._wire.answered(1)
                    continue
                pending += data
                for frame in frames(pending):
                    if frame is None:
                        # Where the next frame would begin, nobody knows.
                        self.drop(client)
                        self._wire.answered(1)
                        break
                    free_s = self._answer(client, frame, free_s)

    def _frame(self, frame: bytes) -> bytes:
        transaction, protocol, _, unit = HEADER.unpack_from(frame)
        if unit not in self._units:
            return b""
        answer = self._registers.answer(frame[HEADER.size :])
        return HEADER.pack(transaction, protocol, len(answer) + 1, unit) + answer


def frames(pending: bytearray) -> Iterator[bytes | None]:
    """Take whole frames off what has come; None, and no more, where a header is none."""
    while len(pending) >= HEADER.size:
        _, protocol, length, _ = HEADER.unpack_from(pending)
        if protocol != 0 or length not in LENGTHS:
            yield None
            return
        end = HEADER.size - 1 + length
        if len(pending) < end:
            return
        frame = bytes(pending[:end])
        del pending[:end]
        yield frame
