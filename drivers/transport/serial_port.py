"""Serial ports, and TCP ports of serial servers, as bytes in and out."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any, Literal, Protocol
from urllib.parse import urlsplit

import serial
from pydantic import Field

from station.roles import DriverSettings

CONNECT_DEADLINE_S = 2.0
WRITE_DEADLINE_S = 0.5
LARGEST_READ_BYTES = 1 << 16
MAX_LEFT_BYTES = 1 << 20


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
