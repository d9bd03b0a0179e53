"""What a Modbus server does with a request, whatever frames it came in: registers and exceptions.

From the application protocol V1.1b3 of the Modbus organisation: functions 3, 4, 6 and 16, and the
exceptions of what cannot be done. Written without a library, so that it checks the one that the
drivers use.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim_instruments.faults.instrument import InstrumentFaults
from sim_instruments.faults.taps import LineTap
from sim_instruments.faults.wire import Reply
from sim_instruments.instrument import Setting
from sim_instruments.wire.requests import RequestServer

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4
MOST_READ, MOST_WRITTEN = 125, 123
Words = Sequence[int]


class ModbusError(Exception):
    """A request that is answered by an exception."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


@dataclass(frozen=True)
class Parameter:
    """A value in one or more registers; `take` is None where it can only be read.

    Both raise ModbusError for what cannot be done.
    """

    give: Callable[[], Words]
    take: Callable[[Words], None] | None = None
    size: int = 1


def fixed(*words: int) -> Parameter:
    """Return a parameter that never changes."""
    return Parameter(lambda: words, size=len(words))


class Registers:
    """The parameters of a device by the address of their first register."""

    def __init__(self) -> None:
        self._parameters: dict[int, Parameter] = {}
        self._owners: dict[int, int] = {}

    def add(self, address: int, parameter: Parameter) -> None:
        """Put a parameter at an address; what lies between parameters reads as zero beside them."""
        self._parameters[address] = parameter
        for offset in range(parameter.size):
            self._owners[address + offset] = address

    def answer(self, request: bytes) -> bytes:
        """Return the answer to a request, both without what frames them."""
        function = request[0] if request else 0
        try:
            if function in (READ_HOLDING, READ_INPUT):
                return self._read(request)
            if function == WRITE_ONE:
                address, value = unpacked(">HH", request[1:])
                self._write(address, (value,))
                return request
            if function == WRITE_MANY:
                address, count, size = unpacked(">HHB", request[1:6])
                if not 0 < count <= MOST_WRITTEN or size != 2 * count or len(request) != 6 + size:
                    raise ModbusError(ILLEGAL_VALUE)
                self._write(address, unpacked(f">{count}H", request[6:]))
                return request[:5]
            raise ModbusError(ILLEGAL_FUNCTION)
        except ModbusError as error:
            return bytes([function | 0x80, error.code])

    def _read(self, request: bytes) -> bytes:
        first, count = unpacked(">HH", request[1:])
        if not 0 < count <= MOST_READ:
            raise ModbusError(ILLEGAL_VALUE)
        if first not in self._owners or first + count - 1 > max(self._owners):
            raise ModbusError(ILLEGAL_ADDRESS)
        words = dict.fromkeys(range(first, first + count), 0)
        for owner in {self._owners[one] for one in words if one in self._owners}:
            for at, word in enumerate(self._parameters[owner].give(), owner):
                if at in words:
                    words[at] = word
        return struct.pack(f">BB{count}H", request[0], 2 * count, *words.values())

    def _write(self, first: int, values: Words) -> None:
        # All is looked at before anything is written.
        takes: list[tuple[Callable[[Words], None], Words]] = []
        at = first
        while at < first + len(values):
            parameter = self._parameters.get(at)
            if parameter is None or parameter.take is None:
                raise ModbusError(ILLEGAL_ADDRESS)
            own = values[at - first : at - first + parameter.size]
            if len(own) != parameter.size:
                raise ModbusError(ILLEGAL_ADDRESS)
            takes.append((parameter.take, own))
            at += parameter.size
        for take, own in takes:
            take(own)


class ModbusTap(LineTap):
    """The faults of a Modbus line, whose requests stand `request_at` bytes into their frames.

    A request is named by what it does and the first register, `read 2820` or `write 2782`.
    """

    def __init__(self, faults: InstrumentFaults | None, request_at: int) -> None:
        super().__init__(faults)
        self._request_at = request_at

    def named(self, line: bytes) -> str:
        """Return the name of a request, as faults are told of it."""
        request = line[self._request_at :]
        if len(request) < 3:
            return ""
        does = {READ_HOLDING: "read", READ_INPUT: "read"}.get(request[0], "write")
        return f"{does} {int.from_bytes(request[1:3], 'big')}"

    def parted(self, answer: bytes) -> Reply | None:
        """Return the whole frame as what may be changed; a frame has no end of line."""
        return Reply(answer) if answer else None


class ModbusServer(RequestServer):
    """Answer for one device, whose requests stand `request_at` bytes into their frames."""

    def __init__(self, setting: Setting, registers: Registers, request_at: int) -> None:
        super().__init__(
            setting.name,
            setting.port,
            setting.clock,
            setting.world.lock,
            ModbusTap(setting.faults, request_at),
            setting.faults,
            at_once=True,
        )
        self._registers = registers


def unpacked(form: str, data: bytes) -> tuple[int, ...]:
    """Return numbers from bytes; ModbusError where they are not as long as they should be."""
    if len(data) != struct.calcsize(form):
        raise ModbusError(ILLEGAL_VALUE)
    return struct.unpack(form, data)
