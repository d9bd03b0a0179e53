"""A Modbus TCP server: the MBAP header, and any number of clients.

From the messaging implementation guide V1.0b of the Modbus organisation: transaction, protocol 0,
length, unit, then the request; the answer repeats the transaction and the unit. A request may
arrive in pieces. An answer goes out in one, because clients read the header by itself.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from sim_instruments.instrument import Setting
from sim_instruments.wire.modbus import ModbusServer, Registers
from sim_instruments.wire.requests import Conversation

HEADER = struct.Struct(">HHHB")
LENGTHS = range(2, 255)
EVERY_UNIT = (0, 255)
"""How a client that speaks to the one device of an address may name it."""


class ModbusTcpServer(ModbusServer):
    """Answer for one device; requests to other units stay without an answer."""

    def __init__(self, setting: Setting, registers: Registers, unit: int) -> None:
        super().__init__(setting, registers, HEADER.size)
        self._units = (unit, *EVERY_UNIT)

    def requests(self, talk: Conversation, data: bytes) -> Iterator[bytes | None]:
        """Take whole frames off what has come; None, and no more, where a header is none."""
        talk.pending += data
        while len(talk.pending) >= HEADER.size:
            _, protocol, length, _ = HEADER.unpack_from(talk.pending)
            if protocol != 0 or length not in LENGTHS:
                yield None
                return
            end = HEADER.size - 1 + length
            if len(talk.pending) < end:
                return
            frame, talk.pending = talk.pending[:end], talk.pending[end:]
            yield frame

    def execute(self, request: bytes) -> bytes:
        """Return the answer to a frame, or nothing."""
        transaction, protocol, _, unit = HEADER.unpack_from(request)
        if unit not in self._units:
            return b""
        answer = self._registers.answer(request[HEADER.size :])
        return HEADER.pack(transaction, protocol, len(answer) + 1, unit) + answer
