"""Ports: what opens a line, moves its bytes, traces them, and says why it cannot be opened.

A serial port, a TCP connection, or a resource of VISA. PyVISA opens and closes every resource. Of a
bare TCP connection that PyVISA-py made, the bytes are taken from the connection itself: PyVISA-py's
own read goes on beyond its deadline as long as bytes come, takes a closed connection for silence,
and its write waits for ever.
"""

from __future__ import annotations

import errno
import math
import select
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol
from urllib.parse import urlsplit

import serial
from pydantic import Field

from station.errors import InstrumentError
from station.roles import DriverSettings, Place

CONNECT_DEADLINE_S = 2.0
WRITE_DEADLINE_S = 0.5
LARGEST_READ_BYTES = 1 << 16
MAX_LEFT_BYTES = 1 << 20
LARGEST_CHUNK_BYTES = 1 << 16

BaudRate = Annotated[int, Field(gt=0, description="serial line: bits in a second")]
DataBits = Annotated[int, Field(ge=5, le=8, description="serial line: bits of data")]
Handshake = Annotated[bool, Field(description="serial line: whether RTS and CTS hold bytes back")]
Parity = Annotated[Literal["N", "E", "O"], Field(description="serial line: none, even or odd")]


class SerialSettings(DriverSettings):
    """How bytes go over a serial line, as most instruments do; a TCP port knows none of it."""

    baud_rate: BaudRate = 9600
    data_bits: DataBits = 8
    parity: Parity = "N"
    stop_bits: float = Field(
        1.0, ge=1, le=2, multiple_of=0.5, description="serial line: 1, 1.5 or 2"
    )
    hardware_handshake: Handshake = False


class Port(Protocol):
    """Bytes in and out; OSError once it is broken."""

    @property
    def is_connection(self) -> bool:
        """Whether what was on its way ends with the port: a network connection."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, or what comes first within a real time; empty for nothing."""
        ...

    def write(self, data: bytes) -> None:
        """Put bytes on the line."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


class Attachment(NamedTuple):
    """How a line is opened, and what to do where it is silent or answers wrongly."""

    wire: str
    """The address by which its bytes are counted: `host:port` of a connection."""
    open: Callable[[], Port]
    """Raises OSError or ValueError."""
    when_silent: str
    when_wrong: str
    begins_quiet: bool = False
    """Whether no late answer can come once it has been opened."""


class SocketPort:
    """A TCP connection, without the pauses in which pyserial opens and closes its own.

    `give_back` closes a connection that somebody else has opened.
    """

    is_connection = True

    def __init__(
        self, connection: socket.socket, give_back: Callable[[], None] | None = None
    ) -> None:
        self._socket, self._give_back = connection, give_back
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, or what comes first within a real time; empty for nothing."""
        try:
            data = self._socket.recv(LARGEST_READ_BYTES)
        except BlockingIOError:
            if timeout_s <= 0.0 or not select.select([self._socket], [], [], timeout_s)[0]:
                return b""
            data = self._socket.recv(LARGEST_READ_BYTES)
        if not data:
            raise ConnectionResetError("the other side closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """Put bytes on the line."""
        left = memoryview(data)
        while left:
            try:
                left = left[self._socket.send(left) :]
            except BlockingIOError:
                if not select.select([], [self._socket], [], WRITE_DEADLINE_S)[1]:
                    raise TimeoutError("the other side takes no more bytes") from None

    def close(self) -> None:
        """Give the port back, once the other side has been sent everything.

        A connection that is closed with bytes unread is reset, and what was sent last is lost.
        """
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            for _ in range(MAX_LEFT_BYTES // LARGEST_READ_BYTES):
                if not self._socket.recv(LARGEST_READ_BYTES):
                    break
        if self._give_back is None:
            self._socket.close()
            return
        try:
            self._give_back()
        except Exception as error:  # VISA libraries have errors of their own
            raise OSError(str(error)) from error


def connected(host: str, port: int) -> SocketPort:
    """Return the port of `socket://host:port`; raises OSError."""
    return SocketPort(socket.create_connection((host, port), CONNECT_DEADLINE_S))


class DevicePort:
    """Whatever pyserial opens by name: `COM3`, `/dev/ttyUSB0`, `rfc2217://host:port`."""

    is_connection = False

    def __init__(self, name: str, framing: SerialSettings) -> None:
        self._port: Any = serial.serial_for_url(
            name,
            baudrate=framing.baud_rate,
            bytesize=framing.data_bits,
            parity=framing.parity,
            stopbits=framing.stop_bits,
            rtscts=framing.hardware_handshake,
            write_timeout=WRITE_DEADLINE_S,
            exclusive=True,
        )

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, or what comes first within a real time; empty for nothing."""
        if timeout_s <= 0.0:
            return bytes(self._port.read(self._port.in_waiting))
        self._port.timeout = timeout_s
        first = bytes(self._port.read(1))
        return first + bytes(self._port.read(self._port.in_waiting)) if first else b""

    def write(self, data: bytes) -> None:
        """Put bytes on the line."""
        self._port.write(data)

    def close(self) -> None:
        """Give the port back."""
        self._port.close()


def open_port(address: str, framing: SerialSettings) -> Port:
    """Open a port by the address of a bench file; raises OSError or ValueError.

    `ASRL/dev/ttyUSB0::INSTR` and `ASRL3::INSTR`, as VISA names ports, are taken, too.
    """
    parts = urlsplit(address)
    if parts.scheme == "socket":
        if not parts.hostname or not parts.port:
            raise ValueError("write socket://host:port")
        return connected(parts.hostname, parts.port)
    name = address
    if address.upper().startswith("ASRL"):
        name = address[4:].split("::")[0]
        name = f"COM{name}" if name.isdigit() else name
    if not name:
        raise ValueError("no port is named")
    return DevicePort(name, framing)


def wire_address(address: str) -> str:
    """Return `host:port` of a socket address, else the address itself."""
    parts = urlsplit(address)
    return parts.netloc if parts.scheme == "socket" else address


def serial_port(address: str, framing: SerialSettings) -> Attachment:
    """Return a serial port, or the TCP port of a serial server, by the address of a bench file."""
    return Attachment(
        wire_address(address),
        lambda: open_port(address, framing),
        "check that the instrument is on, its cable is seated, and the baud rate",
        "check the cable, the baud rate, and that nobody else talks to the instrument",
    )


def is_socket(resource_name: str) -> bool:
    """Whether a resource is a bare TCP connection, where nothing but the bytes ends an answer."""
    parts = resource_name.split("::")
    return len(parts) == 4 and parts[-1].upper() == "SOCKET"


def visa_resource(name: str, library: str, answer_end: str) -> Attachment:
    """Return a resource of a VISA library, `@py` or the path of the vendor's."""
    parts = name.split("::")
    return Attachment(
        f"{parts[1]}:{parts[2]}" if is_socket(name) else name,
        lambda: open_resource(name, library, answer_end),
        "check that the instrument is on, in remote mode, and its cable is seated",
        "check the cable, that nobody else talks to the instrument, and the baud rate where the "
        "line is serial",
        begins_quiet=True,
    )


def open_resource(name: str, library: str, answer_end: str) -> Port:
    """Open a resource of a VISA library; raises OSError."""
    import pyvisa

    try:
        # PyVISA keeps one manager a library and makes a new one where somebody closed it.
        resource: Any = pyvisa.ResourceManager(library).open_resource(
            name, open_timeout=int(1000 * CONNECT_DEADLINE_S), read_termination=answer_end
        )
    except Exception as error:  # pyvisa-py raises bare Exception for a refused connection
        raise OSError(getattr(error, "errno", None), str(error)) from error
    session = getattr(resource.visalib, "sessions", {}).get(resource.session)
    connection = getattr(session, "interface", None)
    if is_socket(name) and isinstance(connection, socket.socket):
        return SocketPort(connection, resource.close)
    return VisaPort(resource, bare=is_socket(name))


class VisaPort:
    """A resource whose library reads: the vendor's, or PyVISA-py for anything but a bare TCP line.

    What lies on the line can be looked for where bytes end an answer: on serial lines and bare TCP
    connections. GPIB, USB, VXI-11 and HiSLIP keep answers and questions together themselves.
    """

    is_connection = False

    def __init__(self, resource: Any, *, bare: bool) -> None:
        from pyvisa import constants, errors

        self._resource, self._bare = resource, bare
        self._errors = (errors.Error, OSError)
        self._timeout = constants.StatusCode.error_timeout
        self._timeout_ms = math.nan
        resource.chunk_size = LARGEST_CHUNK_BYTES
        if bare:
            # What came of an answer without its end is then given out, and can be shown.
            with suppress(errors.Error):
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
        except self._errors as error:
            raise OSError(str(error)) from error

    def write(self, data: bytes) -> None:
        """Put bytes on the line."""
        try:
            self._resource.write_raw(data)
        except self._errors as error:
            raise OSError(str(error)) from error

    def close(self) -> None:
        """Give the resource back."""
        with suppress(*self._errors):
            self._resource.close()

    def _read(self, timeout_s: float) -> bytes:
        timeout_ms = 1000 * timeout_s
        if timeout_ms != self._timeout_ms:  # it is nearly always the same, and setting it is slow
            self._resource.timeout = self._timeout_ms = timeout_ms
        try:
            # One call of the library, which ends with the answer, its chunk, or its time.
            data, _ = self._resource.visalib.read(self._resource.session, LARGEST_CHUNK_BYTES)
        except self._errors as error:
            if getattr(error, "error_code", None) == self._timeout:
                return b""
            raise
        return bytes(data)


class TracedLine:
    """What every line does alike."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._clock = place.clock
        self._trace = place.trace

    def _traced(self, direction: str, data: bytes) -> None:
        if self._trace is not None:
            self._trace(direction, data)

    def _fault(
        self,
        attempted: str,
        came_back: str,
        do_now: str,
        kind: type[InstrumentError] = InstrumentError,
    ) -> InstrumentError:
        self._traced("!", f"{attempted}: {came_back}".encode())
        return kind(self._place.name, attempted, came_back, do_now)

    def _not_opened(self, error: BaseException) -> InstrumentError:
        """Return the error of a line that cannot be opened, with what to do about its cause."""
        why_not = " ".join(str(error).split())
        known = why_not_opened(self._place.address, error)
        if known is None:
            return self._nobody_answers(why_not)
        why, do_now = known
        return self._fault(f"open {self._place.address}", f"{why} ({why_not})", do_now)

    def _nobody_answers(
        self, why: object, do_now: str = "switch the instrument on, check its cable"
    ) -> InstrumentError:
        return self._fault(
            f"open {self._place.address}",
            f"nothing answers there ({why})",
            f"{do_now} and the address in the bench file",
        )


BUSY = (errno.EBUSY, errno.EAGAIN)
PYTHON_VISA = "@py"
GPIB, USB = "GPIB", "USB"
USUAL_GROUP = "dialout"
NO_LIBRARY = ("error while accessing", "wrapper not found", "could not open visa library")
NO_BACKEND = "please install"
NO_RESOURCE = ("vi_error_inv_rsrc_name", "vi_error_rsrc_nfound")


def why_not_opened(address: str, error: BaseException) -> tuple[str, str] | None:
    """Return what is wrong at an address, and what to do about it; None where nobody answers.

    `error` is what the system, pyserial or the VISA library raised.
    """
    return _serial(address, error) or _visa(address, error)


def _serial(address: str, error: BaseException) -> tuple[str, str] | None:
    port = _port_of(address)
    if port is None:
        return None
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.ENOENT or "no ports found" in str(error):
        return (
            f"this computer has no serial port {port}",
            "plug its adapter in, look with `station scan` which ports there are, and correct the "
            "address in the bench file",
        )
    if number in (errno.EACCES, errno.EPERM):
        group = _group_of(port)
        return (
            f"this user may not use the serial port {port}, which is the group {group}'s",
            f"have an administrator run `usermod -aG {group} USER`, then log in again",
        )
    if number in BUSY:
        return (
            f"another program uses the serial port {port}",
            f"end that program (`fuser -v {port}` shows it on Linux), then try again",
        )
    return None


def _visa(address: str, error: BaseException) -> tuple[str, str] | None:
    reason, kind = str(error).lower(), address.upper()
    if any(words in reason for words in NO_LIBRARY):
        return (
            "the VISA library of settings.visa_library cannot be loaded",
            "install the maker's VISA, or correct its path in the bench file; without "
            f"visa_library the Python library {PYTHON_VISA} is used, for everything but GPIB",
        )
    if NO_BACKEND in reason and kind.startswith(GPIB):
        return (
            "the VISA library in use has no GPIB",
            "state the library of the GPIB adapter's maker as settings.visa_library in the bench "
            "file, or install linux-gpib with its Python package `gpib`",
        )
    if NO_BACKEND in reason and kind.startswith(USB):
        return (
            "the VISA library in use has no USB",
            "install the Python packages `pyusb` and `libusb-package`, or state the maker's "
            "library as settings.visa_library in the bench file",
        )
    if any(words in reason for words in NO_RESOURCE):
        return (
            "the VISA library reports no such resource",
            "switch the instrument on, check its cable, and look with `station scan` which "
            "resources there are",
        )
    return None


def _port_of(address: str) -> str | None:
    """Return the serial port of an address, None for a line of another kind."""
    if address.upper().startswith("ASRL"):
        name = address[4:].split("::")[0]
        return f"COM{name}" if name.isdigit() else name
    other = "::" in address or ("://" in address and not address.startswith("hwgrep://"))
    return None if other else address


def _group_of(port: str) -> str:
    """Return the group that may use a port; that of most systems where it is not known."""
    with suppress(NotImplementedError, OSError, KeyError):
        name = Path(port).group()
        return USUAL_GROUP if name == "root" else name
    return USUAL_GROUP
