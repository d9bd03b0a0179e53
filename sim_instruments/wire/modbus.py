"""Modbus servers, TCP and RTU: registers, exceptions, and the frames that they come in.

From the application protocol V1.1b3 of the Modbus organisation: functions 3, 4, 6 and 16, and the
exceptions of what cannot be done. Written without a library, so that it checks the one that the
drivers use.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from sim_instruments.faults.instrument import InstrumentFaults, LineTap
from sim_instruments.faults.wire import Reply
from sim_instruments.instrument import Setting
from sim_instruments.wire.requests import Conversation, RequestServer

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4
MAX_READ, MAX_WRITTEN = 125, 123
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


def shown(give: Callable[[], float]) -> Parameter:
    """Return a signed number in one register that can only be read."""
    return Parameter(lambda: signed(give()))


def chosen(
    known: Collection[int], give: Callable[[], int], take: Callable[[int], object]
) -> Parameter:
    """Return a word that can be one of several, refused as an illegal value otherwise."""

    def taken(words: Words) -> None:
        if words[0] not in known:
            raise ModbusError(ILLEGAL_VALUE)
        take(words[0])

    return Parameter(lambda: (give(),), taken)


class Registers:
    """The parameters of a device by the address of their first register."""

    def __init__(self, table: Mapping[int, Parameter]) -> None:
        self._parameters: dict[int, Parameter] = {}
        self._owners: dict[int, int] = {}
        for address, parameter in table.items():
            self.add(address, parameter)

    def add(self, address: int, parameter: Parameter) -> None:
        """Put a parameter at an address; what lies between parameters reads as zero beside them."""
        self._parameters[address] = parameter
        for offset in range(parameter.size):
            self._owners[address + offset] = address

    def __contains__(self, address: int) -> bool:
        return address in self._owners

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
                if not 0 < count <= MAX_WRITTEN or size != 2 * count or len(request) != 6 + size:
                    raise ModbusError(ILLEGAL_VALUE)
                self._write(address, unpacked(f">{count}H", request[6:]))
                return request[:5]
            raise ModbusError(ILLEGAL_FUNCTION)
        except ModbusError as error:
            return bytes([function | 0x80, error.code])

    def _read(self, request: bytes) -> bytes:
        first, count = unpacked(">HH", request[1:])
        if not 0 < count <= MAX_READ:
            raise ModbusError(ILLEGAL_VALUE)
        if first not in self._owners or first + count - 1 > max(self._owners):
            raise ModbusError(ILLEGAL_ADDRESS)
        words = dict.fromkeys(range(first, first + count), 0)
        for owner in {self._owners[word] for word in words if word in self._owners}:
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
        """Return the name of a request, as faults name it."""
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


def signed(value: float) -> Words:
    """Return a signed number as a register."""
    return (round(value) & 0xFFFF,)


def number(word: int) -> int:
    """Return a register as a signed number."""
    return word - 0x10000 if word & 0x8000 else word


def unpacked(form: str, data: bytes) -> tuple[int, ...]:
    """Return numbers from bytes; ModbusError where they are not as long as they should be."""
    if len(data) != struct.calcsize(form):
        raise ModbusError(ILLEGAL_VALUE)
    return struct.unpack(form, data)


POLYNOMIAL = 0xA001
SILENCE_S = 0.02
"""What ends a frame: more than three and a half characters at 9600 Bd, and some."""

SHORTEST, FIXED, BEFORE_DATA, LONGEST = 4, 8, 7, 256
EVERYBODY = 0


class ModbusRtuServer(ModbusServer):
    """Answer for one device on a serial line, which is served on a TCP port.

    From the serial line guide V1.02 of the Modbus organisation: unit, request, CRC-16 with its low
    byte first; a silence ends a frame. What has a wrong check sum, or is meant for another unit,
    stays without an answer; what is meant for all (unit 0) is carried out without one.
    """

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


HEADER = struct.Struct(">HHHB")
LENGTHS = range(2, 255)
EVERY_UNIT = (0, 255)
"""How a client that speaks to the one device of an address may name it."""


class ModbusTcpServer(ModbusServer):
    """Answer for one device; requests to other units stay without an answer.

    From the messaging implementation guide V1.0b: the MBAP header of transaction, protocol 0,
    length and unit, then the request; the answer repeats the transaction and the unit. A request
    may arrive in pieces. An answer goes out in one, because clients read the header by itself.
    """

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
