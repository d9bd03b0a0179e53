"""Registers of a Modbus device, over TCP or in RTU frames on a serial line, by exchanges.

Frames are made and read by pymodbus. Its own client is not used: that one waits by the operating
system's time, and a run may be on another.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from urllib.parse import urlsplit

from pydantic import Field
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from drivers.transport.exchanges import NEVER, ExchangeLine, Repeatable
from drivers.transport.ports import (
    Attachment,
    Port,
    SerialSettings,
    connected,
    open_port,
    wire_address,
)
from station.errors import InstrumentError, reason_of
from station.roles import Place

NO_REGISTER, DEVICE_FAILURE = 2, 4
REFUSALS = {
    1: (
        "it knows no such function",
        "check that the address in the bench file is this controller's",
    ),
    2: (
        "it has no such register",
        "check that the model and the settings in the bench file are this controller's",
    ),
    3: ("it does not take this value", "compare the value with the controller's own limits"),
    4: (
        "it failed at it, or has no such input or output",
        "compare the modules it is fitted with and the bench file, and look at its front panel",
    ),
    6: ("it is busy", "wait a moment and run again; see that nobody else loads it"),
}
"""By exception code: what it means, what to do now."""


class ModbusRefusal(InstrumentError):
    """A device that answered with an exception; `code` is the exception's."""

    def __init__(self, place: Place, attempted: str, code: int) -> None:
        meaning, do_now = REFUSALS.get(
            code, ("it refused", "look the exception up in the controller's manual")
        )
        super().__init__(place.name, attempted, f"{meaning} (exception {code})", do_now)
        self.code = code


SCHEME = "modbus-tcp"
PORT = 502
LAST_TRANSACTION = 0xFFFF
BITS_OF_SILENCE = 3.5 * 11
MIN_SILENCE_S = 1.75e-3
"""What ends a frame on a serial line: three and a half characters, by the standard not less."""


class ModbusSettings(SerialSettings):
    """Which device of a Modbus line is meant, and the line where it is serial."""

    unit: int = Field(1, ge=1, le=247, description="Modbus address")


class ModbusLine(ExchangeLine):
    """One device's registers; addresses count from zero, values are 0 to 65535.

    An address `modbus-tcp://host:port` (502 unless given) is Modbus TCP; a serial port, or
    `socket://host:port` of a serial server, speaks RTU. After an exchange that failed the line is
    opened anew and read until it is quiet, so that no late answer is taken for the next.
    """

    largest_bytes = 1024

    def __init__(
        self,
        place: Place,
        settings: ModbusSettings,
        repeatable: Repeatable = NEVER,
        witness: Sequence[tuple[int, int]] = (),
    ) -> None:
        self._witness = tuple(witness)
        self._known: list[list[int]] | None = None
        self._framing = settings
        self._unit = settings.unit
        parts = urlsplit(place.address)
        self._tcp = parts.scheme == SCHEME
        self._host, self._tcp_port = parts.hostname or "", (self._tcp and parts.port) or PORT
        self._framer = (FramerSocket if self._tcp else FramerRTU)(DecodePDU(False))
        self._silence_s = max(BITS_OF_SILENCE / self._framing.baud_rate, MIN_SILENCE_S)
        self._silent_from_s = -1.0
        self._transaction = 0
        # pymodbus' own log says every fault again, in its own words.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        address = f"{self._host}:{self._tcp_port}" if self._tcp else wire_address(place.address)
        attachment = Attachment(
            address,
            self._port_opened,
            "check that the instrument is on, its cable is seated, and its Modbus address",
            "check the cable, the line's settings, and that no other client polls it",
        )
        super().__init__(place, attachment, repeatable)

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return `count` registers from `address` on.

        Raises ModbusRefusal for an exception, InstrumentTimeout when no whole answer comes within
        its deadline.
        """
        return self.patiently(f"read {address}", lambda: self._read(address, count))

    def _read(self, address: int, count: int) -> list[int]:
        request = ReadHoldingRegistersRequest(address=address, count=count)
        reply = self._ask(request, f"read {address}", f"read register {address}")
        if len(reply.registers) != count:
            raise self._wrong(
                f"read register {address}",
                f"{len(reply.registers)} registers came back where {count} were asked for",
            )
        return [int(value) for value in reply.registers]

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write registers from `address` on, as one: function 6 for one register, 16 for more."""
        self.patiently(f"write {address}", lambda: self._write(address, values))

    def _write(self, address: int, values: Sequence[int]) -> None:
        request: ModbusPDU
        if len(values) == 1:
            request = WriteSingleRegisterRequest(address=address, registers=list(values))
        else:
            request = WriteMultipleRegistersRequest(address=address, registers=list(values))
        attempted = f"write {', '.join(map(str, values))} to register {address}"
        reply = self._ask(request, f"write {address}", attempted)
        echo = reply.registers == list(values) if len(values) == 1 else reply.count == len(values)
        if reply.address != address or not echo:
            raise self._wrong(attempted, "the answer is to another request")

    def set(self, address: int, word: int) -> None:
        """Write one register and read it back; InstrumentError for another value."""
        self.write(address, [word])
        (read_back,) = self.read(address)
        if read_back != word:
            raise self.another(address, signed(word), signed(read_back))

    def another(self, address: int, written: float, read_back: float) -> InstrumentError:
        """Return the error of a value that reads back as another one."""
        return InstrumentError(
            self._place.name,
            f"write {written:g} to register {address}",
            f"{read_back:g} reads back",
            "see that nobody works at the controller's panel, then run again",
        )

    def tell(self, address: int, value: int) -> None:
        """Send that a register is written and wait for no answer: a last attempt."""
        request = WriteSingleRegisterRequest(address=address, registers=[value])
        self._transaction = self._transaction % LAST_TRANSACTION + 1
        request.dev_id, request.transaction_id = self._unit, self._transaction
        frame = self._framer.buildFrame(request)
        attempted = f"write {value} to register {address}"
        self._attempt(lambda port: self._send(port, attempted, frame), attempted)
        self._must_calm = True  # the answer that comes all the same is nobody's

    def echoes_identity(self) -> bool:
        """Whether answers are those to the last questions, by reading `witness` once more.

        By TCP every answer bears the number of its question. On a serial line one of the same
        length could be that to another: `witness` names registers, each with its count, whose
        values together are nobody else's.
        """
        if self._tcp or not self._witness:
            return True
        identity = [self._read(address, count) for address, count in self._witness]
        if self._known is None:
            before = identity
            identity = [self._read(address, count) for address, count in self._witness]
            self._known = identity if before == identity else None
        return identity == self._known

    def _ask(self, request: ModbusPDU, message: str, attempted: str) -> ModbusPDU:
        reply = self._exchange(message, lambda port: self._once(port, request, message, attempted))
        if isinstance(reply, ExceptionResponse):
            refusal = ModbusRefusal(self._place, attempted, reply.exception_code)
            self._traced("!", str(refusal).encode())
            raise refusal
        return reply

    def _once(self, port: Port, request: ModbusPDU, message: str, attempted: str) -> ModbusPDU:
        self._keep_silence()
        self._transaction = self._transaction % LAST_TRANSACTION + 1
        request.dev_id, request.transaction_id = self._unit, self._transaction
        self._send(port, attempted, self._framer.buildFrame(request))
        reply = self._reply(port, attempted, self.deadline_of_s(message))
        self._silent_from_s = self._clock.now()
        if isinstance(reply, ExceptionResponse) or reply.function_code == request.function_code:
            return reply
        raise self._wrong(attempted, "the answer is to another request")

    def _keep_silence(self) -> None:
        """Leave the silence between two frames that a serial line needs."""
        if not self._tcp:
            left_s = self._silent_from_s + self._silence_s - self._clock.now()
            if left_s > 0:
                self._clock.sleep(left_s)

    def _reply(self, port: Port, attempted: str, deadline_s: float) -> ModbusPDU:
        """Return the one answer, which is whole, has its check sum, and is to the last request."""
        used, reply = 0, None

        def is_whole(answer: bytes) -> bool:
            nonlocal used, reply
            used, reply = self._decoded(answer, attempted)
            return reply is not None or used > 0

        answer = self._receive(port, attempted, deadline_s, is_whole)
        if reply is not None:
            if self._framer.buildFrame(reply) != answer:
                # On a serial line the frame that came first may be to another question.
                self._doubt(answer, attempted)
                raise self._doubtful(attempted, f"more than one answer came ({shown(answer)})")
            return reply
        if used:
            what = "is to another request" if self._tcp else "has a wrong check sum"
            raise self._wrong(attempted, f"the answer {what} ({shown(answer)})")
        what = f"only {shown(answer)} came, which is no whole answer,"
        raise self._silent(attempted, what, deadline_s)

    def _port_opened(self) -> Port:
        if not self._tcp:
            return open_port(self._place.address, self._framing)
        if not self._host:
            raise ValueError(f"write {SCHEME}://host:port")
        return connected(self._host, self._tcp_port)

    def _decoded(self, answer: bytes, attempted: str) -> tuple[int, ModbusPDU | None]:
        """Return how much of an answer was used, and what it is; None for what is not to us."""
        try:
            return self._framer.handleFrame(answer, self._unit, self._transaction)
        except (ModbusException, IndexError, ValueError) as error:
            what = f"{shown(answer)} came back, which is no Modbus ({reason_of(error)})"
            raise self._wrong(attempted, what) from error


def signed(word: int) -> int:
    """Return a register as a signed number."""
    return word - 0x10000 if word & 0x8000 else word


def shown(data: bytes, most: int = 24) -> str:
    """Return bytes in hexadecimal, the end left out when there are many."""
    return data[:most].hex(" ") + (" …" if len(data) > most else "")
