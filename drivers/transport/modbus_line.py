"""Registers of a Modbus device, over TCP or in RTU frames on a serial line, by exchanges.

Frames are made and read by pymodbus. Its own client is not used: that one waits by the operating
system's time, and a run may be on another.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from drivers.roles import Place
from drivers.transport.modbus_refusal import ModbusRefusal
from drivers.transport.serial_port import (
    Framing,
    Port,
    SocketPort,
    framing_of,
    one_line,
    open_port,
    wire_address,
)
from station.errors import InstrumentError, InstrumentTimeout

EXCHANGE_DEADLINE_S = 0.5
QUIET_S = 0.1
"""A line on which nothing has come for this run time has nothing more on its way."""

QUIET_LOOKS = 10
SCHEME = "modbus-tcp"
PORT = 502
UNITS = range(1, 248)
LAST_TRANSACTION = 0xFFFF
BITS_OF_SILENCE = 3.5 * 11
LEAST_SILENCE_S = 1.75e-3
"""What ends a frame on a serial line: three and a half characters, by the standard not less."""


class ModbusLine:
    """One device's registers; addresses count from zero, values are 0 to 65535.

    An address `modbus-tcp://host:port` (502 unless given) is Modbus TCP; a serial port, or
    `socket://host:port` of a serial server, speaks RTU with `framing`, which the bench file's
    settings change as on every serial line. After an exchange that failed the line is opened anew
    and read until it is quiet, so that no late answer is taken for the next.
    """

    def __init__(self, place: Place, unit: int, framing: Framing) -> None:
        self._place = place
        self._clock = place.clock
        self._trace = place.trace
        self._framing = framing_of(place, framing)
        self._unit = unit
        parts = urlsplit(place.address)
        self._tcp = parts.scheme == SCHEME
        self._host, self._tcp_port = parts.hostname or "", (self._tcp and parts.port) or PORT
        self._framer = (FramerSocket if self._tcp else FramerRTU)(DecodePDU(False))
        self._silence_s = max(BITS_OF_SILENCE / self._framing.baud_rate, LEAST_SILENCE_S)
        self._silent_from_s = -1.0
        self._transaction = 0
        # pymodbus' own log says every fault again, in its own words.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        self._lock = place.clock.lock(f"{place.name} line")
        address = f"{self._host}:{self._tcp_port}" if self._tcp else wire_address(place.address)
        self._wire = place.clock.wire(address)
        self._port: Port | None = None
        self._opened = 0
        self._open()

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return `count` registers from `address` on.

        Raises ModbusRefusal for an exception, InstrumentTimeout when no whole answer comes within
        half a second of run time.
        """
        request = ReadHoldingRegistersRequest(address=address, count=count)
        reply = self._exchange(request, f"read register {address}")
        if len(reply.registers) != count:
            raise self._wrong(
                f"read register {address}",
                f"{len(reply.registers)} registers came back where {count} were asked for",
            )
        return [int(value) for value in reply.registers]

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write registers from `address` on, as one: function 6 for one register, 16 for more."""
        request: ModbusPDU
        if len(values) == 1:
            request = WriteSingleRegisterRequest(address=address, registers=list(values))
        else:
            request = WriteMultipleRegistersRequest(address=address, registers=list(values))
        attempted = f"write {', '.join(map(str, values))} to register {address}"
        reply = self._exchange(request, attempted)
        echo = reply.registers == list(values) if len(values) == 1 else reply.count == len(values)
        if reply.address != address or not echo:
            raise self._wrong(attempted, "the answer is to another request")

    def close(self) -> None:
        """Close the line; one that is already gone is no error."""
        if self._port is not None:
            self._traced("-", b"closed")
        self._disconnect()

    def _exchange(self, request: ModbusPDU, attempted: str) -> ModbusPDU:
        with self._lock:
            port = self._port if self._port is not None else self._open()
            with self._breaks("looked for what had come unasked"):
                self._forget(port)
            self._keep_silence()
            self._transaction = self._transaction % LAST_TRANSACTION + 1
            request.dev_id, request.transaction_id = self._unit, self._transaction
            try:
                sent = self._framer.buildFrame(request)
                with self._breaks(attempted):
                    self._wire.sent(len(sent))
                    self._traced(">", sent)
                    port.write(sent)
                reply = self._read(port, attempted)
                self._wire.received()
                self._silent_from_s = self._clock.now()
                if isinstance(reply, ExceptionResponse):
                    refusal = ModbusRefusal(self._place, attempted, reply.exception_code)
                    self._traced("!", str(refusal).encode())
                elif reply.function_code == request.function_code:
                    return reply
                else:
                    raise self._wrong(attempted, "the answer is to another request")
            except BaseException:  # whoever comes next must not read this answer as its own
                self._disconnect()
                raise
        raise refusal

    def _keep_silence(self) -> None:
        """Leave the silence between two frames that a serial line needs."""
        if not self._tcp:
            left_s = self._silent_from_s + self._silence_s - self._clock.now()
            if left_s > 0:
                self._clock.sleep(left_s)

    def _read(self, port: Port, attempted: str) -> ModbusPDU:
        """Return the one answer, which is whole, has its check sum, and is to the last request."""
        if not self._wire.wait(self._clock.now() + EXCHANGE_DEADLINE_S):
            with self._breaks(attempted):
                self._forget(port)
            raise self._silent(attempted, "no answer came")
        until_s = self._clock.now() + self._clock.patience_s(EXCHANGE_DEADLINE_S)
        left_s = EXCHANGE_DEADLINE_S
        answer, used, reply = b"", 0, None
        try:
            with self._breaks(attempted):
                while reply is None and not used and left_s > 0:
                    came = port.read(self._clock.real_timeout_s(left_s))
                    if not came:
                        break
                    answer += came
                    used, reply = self._decoded(answer, attempted)
                    left_s = until_s - self._clock.now()
        finally:
            if answer:
                self._traced("<", answer)
        if reply is not None:
            return reply
        if used:
            what = "is to another request" if self._tcp else "has a wrong check sum"
            raise self._wrong(attempted, f"the answer {what} ({shown(answer)})")
        if not answer:
            raise self._silent(attempted, "no answer came")
        raise self._silent(attempted, f"only {shown(answer)} came, which is no whole answer,")

    def _decoded(self, answer: bytes, attempted: str) -> tuple[int, ModbusPDU | None]:
        """Return how much of an answer was used, and what it is; None for what is not to us."""
        try:
            return self._framer.handleFrame(answer, self._unit, self._transaction)
        except (ModbusException, IndexError, ValueError) as error:
            what = f"{shown(answer)} came back, which is no Modbus ({one_line(error)})"
            raise self._wrong(attempted, what) from error

    def _open(self) -> Port:
        port: Port | None = None
        try:
            if not self._tcp:
                port = open_port(self._place.address, self._framing)
            elif self._host:
                port = SocketPort(self._host, self._tcp_port)
            else:
                raise ValueError(f"write {SCHEME}://host:port")
            self._wire.open()
            self._opened += 1
            self._traced("-", b"opened" if self._opened == 1 else b"reopened")
            if self._opened > 1 or not isinstance(port, SocketPort):
                self._await_quiet(port)
        except BaseException as error:
            self._wire.close()
            if port is not None:
                port.close()
            if not isinstance(error, OSError | ValueError):
                raise
            raise self._fault(
                InstrumentError,
                f"open {self._place.address}",
                f"nobody answers there ({one_line(error)})",
                "switch the instrument on, check its cable and the address in the bench file",
            ) from error
        self._port = port
        return port

    def _await_quiet(self, port: Port) -> None:
        for _ in range(QUIET_LOOKS):
            self._clock.sleep(QUIET_S)
            if not self._forget(port):
                return

    def _forget(self, port: Port) -> bool:
        """Read what has come unasked and forget it; return whether there was anything."""
        found = False
        while data := port.read(0.0):
            found = True
            self._traced("<", data)
            self._traced("-", b"not asked for, forgotten")
        if found:
            self._wire.received()
        return found

    def _disconnect(self) -> None:
        self._wire.close()
        port, self._port = self._port, None
        if port is not None:
            with suppress(OSError):
                port.close()

    def _traced(self, direction: str, data: bytes) -> None:
        if self._trace is not None:
            self._trace(direction, data)

    def _fault(
        self, kind: type[InstrumentError], attempted: str, came_back: str, do_now: str
    ) -> InstrumentError:
        self._traced("!", f"{attempted}: {came_back}".encode())
        return kind(self._place.name, attempted, came_back, do_now)

    def _silent(self, attempted: str, what: str) -> InstrumentError:
        return self._fault(
            InstrumentTimeout,
            attempted,
            f"{what} within {EXCHANGE_DEADLINE_S:g} s",
            "check that the instrument is on, its cable is seated, and its Modbus address",
        )

    def _wrong(self, attempted: str, came_back: str) -> InstrumentError:
        do_now = "check the cable, the line's settings, and that nobody else asks as we do"
        return self._fault(InstrumentError, attempted, came_back, do_now)

    @contextmanager
    def _breaks(self, attempted: str) -> Iterator[None]:
        """Tell an OSError inside as a line that broke, which is then closed."""
        try:
            yield
        except OSError as error:
            self._disconnect()
            raise self._fault(
                InstrumentError,
                attempted,
                f"the line broke ({one_line(error)})",
                "check the cable and the instrument's power, then start again",
            ) from error


def shown(data: bytes, most: int = 24) -> str:
    """Return bytes in hexadecimal, the end left out when there are many."""
    return data[:most].hex(" ") + (" …" if len(data) > most else "")
