"""A serial line that carries binary frames both ways, on a TCP port as a serial server has one.

The checksum is CRC-32 as the data sheet of STIM300 (TS1524) has it: polynomial 0x04C11DB7, seed
0xFFFFFFFF, not reflected, no final XOR; written from that alone. Of as many bytes as a multiple of
four it is CRC-32/MPEG-2.
"""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from threading import Lock
from typing import ClassVar, NamedTuple

from sim_instruments.faults.instrument import FrameTap
from sim_instruments.faults.wire import Reply
from sim_instruments.instrument import Electronics, ServedInstrument, Setting
from sim_instruments.wire.tcp import TcpServer, is_closed

MAX_PENDING = 4096


class Arrived(NamedTuple):
    """What is found in bytes from a client: frames with the names of their messages, and a rest."""

    frames: list[tuple[str, bytes]]
    rest: bytes


CRC_BYTES = 4
UNKNOWN = 1 << 30
"""The size of a frame of which more must come to know it."""


def with_crc(data: bytes) -> bytes:
    """Return a frame with its checksum behind it."""
    return data + crc32(data).to_bytes(CRC_BYTES, "big")


def frames_in(
    pending: bytes,
    sync: bytes,
    size_of: Callable[[bytes], int],
    named: Callable[[bytes], list[tuple[str, bytes]]],
) -> Arrived:
    """Return the frames that bytes hold; what has a wrong checksum is passed over.

    Each begins with `sync` and ends with a checksum. `size_of` says how long one is that begins
    here: UNKNOWN where more must come to know it, 0 where none can be; `named` makes the
    frames of its bytes without the checksum, or none.
    """
    frames: list[tuple[str, bytes]] = []
    while (begin := pending.find(sync)) >= 0:
        pending = pending[begin:]
        size = size_of(pending)
        if len(pending) < size:
            return Arrived(frames, pending)
        data, checksum = pending[: size - CRC_BYTES], pending[size - CRC_BYTES : size]
        if not size or checksum != crc32(data).to_bytes(CRC_BYTES, "big"):
            pending = pending[1:]
            continue
        pending = pending[size:]
        frames += named(data)
    return Arrived(frames, pending[-1:] if pending.endswith(sync[:1]) else b"")


class FrameStreamServer(TcpServer):
    """Carry frames between one client and one instrument; a new client takes the line over.

    `split` finds the client's frames, `received` carries one out, as the running participant and
    with the world's lock held. Faults meet frames by the names that `split` and `send` are given.
    One unit on the clock's wire is one byte.
    """

    def __init__(
        self,
        setting: Setting,
        split: Callable[[bytes], Arrived],
        received: Callable[[bytes], None],
    ) -> None:
        super().__init__(setting.name, setting.port, setting.clock, setting.faults)
        self._wire = setting.clock.wire(self.address)
        self._lock = setting.world.lock
        self._split = split
        self._received = received
        self._wrong = setting.faults
        self._tap = FrameTap(setting.faults)
        self._client: socket.socket | None = None
        self._sending = Lock()
        self._arrived: Callable[[], None] | None = None

    def when_connected(self, act: Callable[[], None]) -> None:
        """Have something done whenever somebody connects, with the world's lock held."""

        def arrived() -> None:
            with self._lock:
                newest = self.connected()
                with self._sending:
                    self._client = self._client or (newest[0] if newest else None)
                act()

        if not self._wire.when_opened(arrived):
            self._arrived = arrived

    def send(self, name: str, frame: bytes) -> None:
        """Send a frame, whose message has a name, to the client if there is one."""
        self._wrong.catch_up()
        reply, drops = self._tap.leaves(name, Reply(frame), self._clock.now())
        if reply is not None and reply.delay_s > 0:
            body = reply.body
            self.later(reply.delay_s, lambda: self._write(body))
        elif reply is not None:
            self._write(reply.body)
        if drops:
            self.drop_all()

    def send_all(self, name: str, frames: Sequence[bytes]) -> None:
        """Send frames of the same name; together where no fault may meet one of them."""
        if not self._tap.idle():
            for frame in frames:
                self.send(name, frame)
        elif frames:
            self._tap.left(name, Reply(frames[-1]))
            self._write(b"".join(frames))

    def serve(self, client: socket.socket) -> None:
        """Take the client's frames until it leaves."""
        with self._sending:
            self._client = client
        if self._arrived is not None:
            self._arrived()
        pending = b""
        try:
            while data := client.recv(65536):
                with self._wire.serving(len(data)):
                    if client in self._dropped:
                        continue
                    arrived = self._split(pending + data)
                    pending = arrived.rest[-MAX_PENDING:]
                    for name, frame in arrived.frames:
                        self._take(name, frame)
        finally:
            with self._sending:
                if self._client is client:
                    self._client = None

    def drop(self, client: socket.socket) -> None:
        """End a connection; it gets no frame any more."""
        with self._sending:
            if self._client is client:
                self._client = None
        super().drop(client)

    def _take(self, name: str, frame: bytes) -> None:
        """Give a frame to the instrument, or not."""
        with self._lock:
            drops = self._tap.arrives(name, partial(self._received, frame), self._clock.now())
        if drops:
            self.drop_all()

    def _write(self, data: bytes) -> None:
        with self._sending:
            client = self._client
            # Who has hung up reads nothing: what is counted as sent to it would hold time up.
            if client is None or is_closed(client):
                return
            self._wire.streamed(len(data))
            with suppress(OSError):
                client.sendall(data)
            self._wire.written()


class FrameInstrument(ServedInstrument, ABC):
    """An instrument on a serial line of its own; `_received` carries out a client's frame."""

    protocol: ClassVar[str] = "frames"
    resource: ClassVar[str] = "socket://{host}:{port}"
    kinds: ClassVar[Mapping[int, str]] = {}
    """What each kind of frame is called, where frames have kinds."""
    _server: FrameStreamServer

    def knows(self, command: str) -> bool:
        """Whether it takes or sends frames of a kind, in hexadecimal digits."""
        return int(command, 16) in self.kinds

    def begin_to_serve(
        self, setting: Setting, split: Callable[[bytes], Arrived], electronics: Electronics
    ) -> None:
        """Listen from now on."""
        self._electronics = electronics
        self._server = FrameStreamServer(setting, split, self._received)
        self._server.begin()

    @abstractmethod
    def _received(self, payload: bytes) -> None:
        """Carry out a request that came in a whole frame."""


POLYNOMIAL, SEED = 0x04C11DB7, 0xFFFFFFFF


def _table() -> list[int]:
    table = []
    for top in range(256):
        remainder = top << 24
        for _ in range(8):
            carry = remainder >> 31
            remainder = (remainder << 1 & 0xFFFFFFFF) ^ (POLYNOMIAL if carry else 0)
        table.append(remainder)
    return table


TABLE = _table()


def crc32(data: bytes) -> int:
    """Return the checksum of a frame: zero bytes fill it up to a multiple of four."""
    crc = SEED
    for byte in data + b"\0" * (-len(data) % 4):
        crc = (crc << 8 & 0xFFFFFFFF) ^ TABLE[crc >> 24 ^ byte]
    return crc
