"""Text messages over VISA: a request and its answer as one exchange.

PyVISA opens and closes every resource. Of a bare TCP connection that PyVISA-py made, the bytes are
taken from the connection itself: PyVISA-py's own read goes on beyond its deadline as long as bytes
come, takes a closed connection for silence, and its write waits for ever.
"""

from __future__ import annotations

import math
import re
import socket
from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any, ClassVar

import pyvisa
from pydantic import Field
from pyvisa import constants

from drivers.transport.line import (
    errors_until_none,
    identification,
    numbers_of,
    shortened,
)
from drivers.transport.retry import NEVER, Repeatable
from drivers.transport.serial_port import CONNECT_DEADLINE_S, Port, SocketPort
from drivers.transport.text_line import TextLine
from station.errors import InstrumentError
from station.roles import Driver, DriverSettings, Identity, Place

LARGEST_CHUNK_BYTES = 1 << 16
ERROR_QUERY = ":SYST:ERR?"
NO_ERROR = r"\+?0,"
TIMEOUT = constants.StatusCode.error_timeout


def resource_manager(library: str) -> pyvisa.ResourceManager:
    """Return the resource manager of a VISA library, `@py` or the path of the vendor's."""
    # PyVISA keeps one a library and makes a new one where somebody closed it.
    return pyvisa.ResourceManager(library)


def is_socket(resource_name: str) -> bool:
    """Whether a resource is a bare TCP connection, where nothing but the bytes ends an answer."""
    parts = resource_name.split("::")
    return len(parts) == 4 and parts[-1].upper() == "SOCKET"


def visa_wire_address(resource_name: str) -> str:
    """Return `host:port` of a socket resource, else the resource name itself."""
    parts = resource_name.split("::")
    return f"{parts[1]}:{parts[2]}" if is_socket(resource_name) else resource_name


class VisaSettings(DriverSettings):
    """The settings of an instrument on a VISA line."""

    visa_library: str = Field(
        "@py", min_length=1, description="path of a vendor's VISA library; `@py` is pyvisa-py"
    )


def visa_port(place: Place, answer_end: str) -> Port:
    """Open a resource, with the library of the bench file's `visa_library`; raises OSError."""
    library = VisaSettings.of(place).visa_library
    try:
        resource: Any = resource_manager(library).open_resource(
            place.address,
            open_timeout=int(1000 * CONNECT_DEADLINE_S),
            read_termination=answer_end,
        )
    except Exception as error:  # pyvisa-py raises bare Exception for a refused connection
        raise OSError(getattr(error, "errno", None), str(error)) from error
    session = getattr(resource.visalib, "sessions", {}).get(resource.session)
    connection = getattr(session, "interface", None)
    if is_socket(place.address) and isinstance(connection, socket.socket):
        return SocketPort(connection, resource.close)
    return VisaPort(resource, bare=is_socket(place.address))


class VisaPort:
    """A resource whose library reads: the vendor's, or PyVISA-py for anything but a bare TCP line.

    What lies on the line can be looked for where bytes end an answer: on serial lines and bare TCP
    connections. GPIB, USB, VXI-11 and HiSLIP keep answers and questions together themselves.
    """

    is_connection = False

    def __init__(self, resource: Any, *, bare: bool) -> None:
        self._resource, self._bare = resource, bare
        self._timeout_ms = math.nan
        resource.chunk_size = LARGEST_CHUNK_BYTES
        if bare:
            # What came of an answer without its end is then given out, and can be shown.
            with suppress(pyvisa.errors.Error):
                attribute = constants.ResourceAttribute.suppress_end_enabled
                resource.set_visa_attribute(attribute, False)

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, or what comes first within a real time; empty for nothing."""
        try:
            if timeout_s > 0.0:
                return self._read(timeout_s)
            waiting = int(getattr(self._resource, "bytes_in_buffer", 0))
            if waiting:
                return bytes(self._resource.read_bytes(waiting, break_on_termchar=True))
            return self._read(0.0) if self._bare else b""
        except (pyvisa.errors.Error, OSError) as error:
            raise OSError(str(error)) from error

    def write(self, data: bytes) -> None:
        """Put bytes on the line."""
        try:
            self._resource.write_raw(data)
        except (pyvisa.errors.Error, OSError) as error:
            raise OSError(str(error)) from error

    def close(self) -> None:
        """Give the resource back."""
        with suppress(pyvisa.errors.Error, OSError):
            self._resource.close()

    def _read(self, timeout_s: float) -> bytes:
        timeout_ms = 1000 * timeout_s
        if timeout_ms != self._timeout_ms:  # it is nearly always the same, and setting it is slow
            self._resource.timeout = self._timeout_ms = timeout_ms
        try:
            # One call of the library, which ends with the answer, its chunk, or its time.
            data, _ = self._resource.visalib.read(self._resource.session, LARGEST_CHUNK_BYTES)
        except pyvisa.errors.VisaIOError as error:
            if error.error_code == TIMEOUT:
                return b""
            raise
        return bytes(data)


class VisaLine(TextLine):
    """One instrument's line at a VISA resource.

    An answer is complete with the last character of `answer_end`.
    """

    when_silent = "check that the instrument is on, in remote mode, and its cable is seated"
    when_wrong = (
        "check the cable, that nobody else talks to the instrument, and the baud rate where the "
        "line is serial"
    )

    def __init__(
        self,
        place: Place,
        *,
        request_end: str = "\n",
        answer_end: str = "\n",
        repeatable: Repeatable = NEVER,
        identity: str = "*IDN?",
        deadlines: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._before_end = answer_end[:-1]
        super().__init__(
            place,
            visa_wire_address(place.address),
            request_end=request_end,
            answer_end=answer_end[-1:],
            repeatable=repeatable,
            identity=identity,
            deadlines=deadlines,
        )

    def _port_opened(self) -> Port:
        return visa_port(self._place, self._before_end + self._answer_end.decode("ascii"))

    def _needs_quiet(self, port: Port) -> bool:
        return False  # a fresh connection has no late answers

    def _unwrapped(self, attempted: str, text: str) -> str:
        return super()._unwrapped(attempted, text).removesuffix(self._before_end)


class ScpiLine(VisaLine):
    """A VISA line whose instrument keeps an error queue that is asked in the same message.

    `error_query` is appended to each command; an empty queue answers with `no_error`, a regular
    expression.
    """

    def __init__(
        self,
        place: Place,
        *,
        error_query: str = ERROR_QUERY,
        no_error: str = NO_ERROR,
        answer_end: str = "\n",
        repeatable: Repeatable = NEVER,
        deadlines: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        super().__init__(place, answer_end=answer_end, repeatable=repeatable, deadlines=deadlines)
        self._error_query = error_query
        self._no_error = re.compile(no_error)

    def command(self, message: str, *, now: bool = False) -> None:
        """Send a command and read the error queue in one exchange; a refusal is InstrumentError.

        One that is due `now` raises TooLate, with nothing sent, where the line is out of step.
        """

        self.patiently(message, lambda: self._command(message, now), now=now)

    def _command(self, message: str, now: bool) -> None:
        answer = self.query(f"{message};{self._error_query}", now=now)
        if not self._no_error.match(answer):
            raise self.refused(message, answer)

    def refused(self, message: str, answer: str) -> InstrumentError:
        """Return the error of a command that the instrument refused with `answer`."""
        return InstrumentError(
            self._place.name,
            f"sent {shortened(message)!r}",
            f"it refused with {shortened(answer)}",
            "compare the plan's and the bench file's values with the instrument's ranges",
        )

    def next_error(self) -> str:
        """Take the oldest error, or all, from the queue; empty where there is none."""
        answer = self.query(self._error_query)
        return "" if self._no_error.match(answer) else answer

    def numbers(self, message: str) -> list[float]:
        """Return the finite numbers of an answer, between commas; an empty answer has none."""
        answer = self.query(message)
        return numbers_of(self._place.name, message, answer.split(",") if answer else [])


class ScpiDriver(Driver):
    """A driver of an instrument with `*IDN?` and an error queue, on a `ScpiLine`."""

    Settings: ClassVar[type[VisaSettings]] = VisaSettings
    on_can = False
    repeatable: ClassVar[Repeatable] = NEVER
    error_query: ClassVar[str] = ERROR_QUERY
    no_error: ClassVar[str] = NO_ERROR
    answer_end: ClassVar[str] = "\n"

    def __init__(self, place: Place) -> None:
        self.place = place
        self._line = ScpiLine(
            place,
            error_query=self.error_query,
            no_error=self.no_error,
            answer_end=self.answer_end,
            repeatable=self.repeatable,
            deadlines=self.deadlines,
        )

    def identify(self) -> Identity:
        """Ask `*IDN?`; the answer is maker, model, serial number, firmware."""
        return Identity(*identification(self.place.name, self._line.query("*IDN?"))[:4])

    def take_errors(self) -> list[str]:
        """Return the errors that it keeps, the oldest first, and leave its queue empty."""
        return errors_until_none(self.place.name, self._line.next_error)
