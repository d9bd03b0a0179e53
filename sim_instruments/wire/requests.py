"""Requests and their answers over a TCP port, whatever a request looks like; and lines."""

from __future__ import annotations

import re
import select
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from threading import Event
from typing import Any, ClassVar

from sim_instruments.faults.instrument import InstrumentFaults, LineTap
from sim_instruments.faults.lasting import Chatter, LastingFault
from sim_instruments.instrument import ServedInstrument, Setting
from sim_instruments.wire.tcp import TcpServer, is_closed
from station.clock import Clock, ClockStopped

LARGEST_READ_BYTES = 65536
MAX_LINE = 1 << 20
"""Of an instrument whose own limit no source gives."""
BLOCK = re.compile(rb"#([1-9])")
AT_ONCE = getattr(socket, "MSG_DONTWAIT", 0)
"""Windows has no such option; there the read waits for what is on its way."""
CHATTER = b"BUSY\r\n"
LOOK_S = 0.005
"""Real time in which bytes that were written on a loopback come out at its other end."""


class Conversation:
    """One client of a server of requests and answers, and what has come of a request so far."""

    def __init__(self, server: RequestServer, client: socket.socket) -> None:
        self._server = server
        self.client = client
        self.name = server.name
        self.pending = b""
        self.heard_s = self.free_s = 0.0
        self.attended = False
        self.unread = Event()

    def look(self) -> bool:
        """Read and answer what has come, in the thread of who sent it; False at the end."""
        try:
            data = self.client.recv(LARGEST_READ_BYTES, AT_ONCE)
            if data:
                self._server.received(self, data)
            return bool(data)
        except BlockingIOError:
            select.select([self.client], [], [], LOOK_S)
            return True
        except (OSError, ClockStopped):
            return False

    def dismissed(self) -> None:
        """Have the server's own thread read again."""
        self.attended = False
        self.unread.set()


class RequestServer(TcpServer):
    """Pass each request to an instrument and send back what it replies.

    With `at_once` no answer takes time of its own, and a clock may have requests answered in the
    thread that sends them. An answer goes out `busy_s` after its request.
    """

    def __init__(
        self,
        name: str,
        port: int,
        clock: Clock,
        lock: AbstractContextManager[object],
        tap: LineTap,
        faults: InstrumentFaults | None = None,
        *,
        at_once: bool = False,
        busy_s: float = 0.0,
    ) -> None:
        super().__init__(name, port, clock, faults)
        self._busy_s = busy_s
        self._wire = clock.wire(self.address)
        self._lock = lock
        self._tap = tap
        self._at_once = at_once
        self._talks: set[Conversation] = set()
        if faults is not None:
            faults.when_changed(Chatter.kind, self._chatter_changed)

    @abstractmethod
    def requests(self, talk: Conversation, data: bytes) -> Iterator[bytes | None]:
        """Yield each request that is whole with `data`; None where the line has to be ended."""

    @abstractmethod
    def execute(self, request: bytes) -> bytes:
        """Return the answer to a request, with its end; nothing where nothing is said."""

    def serve(self, client: socket.socket) -> None:
        """Read requests until the client leaves."""
        talk = Conversation(self, client)
        with self._guard:
            self._talks.add(talk)
        try:
            while data := client.recv(LARGEST_READ_BYTES):
                if self.received(talk, data):
                    talk.unread.wait()
                    talk.unread.clear()
        finally:
            with self._guard:
                self._talks.discard(talk)

    def close(self) -> None:
        """Close the port and all connections."""
        super().close()
        with self._guard:
            for talk in self._talks:
                talk.unread.set()

    def received(self, talk: Conversation, data: bytes) -> bool:
        """Answer what came; return whether from now on whoever sends also has it answered."""
        with self._wire.serving(len(data)):
            if talk.client in self._dropped:
                self._wire.answered(1)
                return False
            for request in self.requests(talk, data):
                if request is None:
                    # Where the next request would begin, nobody knows.
                    self.drop(talk.client)
                    self._wire.answered(1)
                    return False
                self._answer(talk, request)
            talk.attended = talk.attended or (self._at_once and self._wire.attend(talk))
            return talk.attended

    def _answer(self, talk: Conversation, request: bytes) -> None:
        """Answer one request, not before the one before it has been."""
        client, now_s = talk.client, self._clock.now()
        with self._lock:
            reply, drops, resets = self._tap.exchange(request, self.execute, now_s)
        if resets:
            self.reset(client)
        elif drops:
            self.drop(client)
        if client in self._dropped:
            # What comes back is the end of the connection, and the client may see it now.
            self._wire.answered(1)
        elif reply is not None and reply.flood:
            self.flood(client, reply.flood)
            self._wire.answered(1)
        elif reply is not None:
            data = reply.body + reply.end
            if reply.ahead:
                client.sendall(reply.ahead)
                self._wire.answered(len(reply.ahead))
            for after_s, more in reply.afterwards:
                self._unasked_later(reply.delay_s + after_s, client, more)
            talk.free_s = max(talk.free_s, now_s + self._busy_s + reply.delay_s)
            if talk.free_s <= now_s:
                client.sendall(data)
                self._wire.answered(len(data))
            else:
                self.later(talk.free_s - now_s, lambda: self._send_late(client, data))

    def _unasked_later(self, delay_s: float, client: socket.socket, data: bytes) -> None:
        """Send what nobody waits for after a while, to a client that is still there."""

        def send() -> None:
            with suppress(OSError):
                if not is_closed(client):
                    client.sendall(data)

        self.later(delay_s, send)

    def _chatter_changed(self, time_s: float, fault: LastingFault | None) -> None:
        """Send a line to every client again and again, for as long as the fault is there."""
        if not isinstance(fault, Chatter):
            return

        def say() -> float | None:
            now_s = self._clock.now()
            if self._closed or not fault.lasts(now_s):
                return None
            for client in self.connected():
                with suppress(OSError):
                    client.send(CHATTER, AT_ONCE)
            return now_s + fault.interval_s

        self._clock.repeat(f"{self._name} chatter", self._clock.now(), say)

    def _send_late(self, client: socket.socket, data: bytes) -> None:
        # Who has hung up gets nothing, and a new connection must not get it.
        if not is_closed(client):
            with suppress(OSError):
                client.sendall(data)
                self._wire.answered(len(data))


class LineServer(RequestServer):
    """Answer lines, which end with `end`, by what `execute` makes of them.

    Of a line beyond `longest` bytes no more than shows that is kept; `too_long` answers it. With
    `blocks` the bytes of a block of definite length (IEEE 488.2, 7.7.6) end no line.
    """

    def __init__(
        self,
        name: str,
        port: int,
        clock: Clock,
        lock: AbstractContextManager[object],
        execute: Callable[[bytes], bytes],
        faults: InstrumentFaults | None = None,
        *,
        end: bytes = b"\n",
        longest: int = MAX_LINE,
        too_long: Callable[[], bytes] = bytes,
        blocks: bool = False,
        **options: Any,
    ) -> None:
        super().__init__(name, port, clock, lock, LineTap(faults), faults, **options)
        self._end = end
        self._execute = execute
        self._longest, self._too_long, self._blocks = longest, too_long, blocks

    def requests(self, talk: Conversation, data: bytes) -> Iterator[bytes]:
        """Yield each line that is whole, or so much of it as shows that it is too long."""
        *lines, pending = self._split(talk.pending + data)
        talk.pending = pending[: self._longest + 1]
        yield from lines

    def execute(self, request: bytes) -> bytes:
        """Return the answer to a line."""
        return self._too_long() if len(request) > self._longest else self._execute(request)

    def _split(self, data: bytes) -> list[bytes]:
        if not self._blocks or b"#" not in data:
            return data.split(self._end)
        lines, begin, look = [], 0, 0
        while (end := data.find(self._end, look)) >= 0:
            inside = block_around(data, look, end)
            if inside > end:
                look = inside
                if look > len(data):
                    break
                continue
            lines.append(data[begin:end])
            begin = look = end + len(self._end)
        return [*lines, data[begin:]]


def block_around(data: bytes, begin: int, place: int) -> int:
    """Return where a block ends that begins between two places and goes beyond the second, else 0.

    In a block there are no others; its head is `#`, the number of digits, and its length in them.
    """
    while head := BLOCK.search(data, begin, place):
        digits = int(head[1])
        length = data[head.end() : head.end() + digits]
        if not length.isdigit() or len(length) < digits:
            begin = head.end()
            continue
        begin = head.end() + digits + int(length)
        if begin > place:
            return begin
    return 0


def without_blocks(line: bytes) -> tuple[bytes, list[bytes]]:
    """Return a line with `#0`, `#1`, … in the place of its blocks, and the blocks."""
    blocks: list[bytes] = []
    text = b""
    while head := BLOCK.search(line):
        begin = head.end() + int(head[1])
        length = line[head.end() : begin]
        if not length.isdigit():
            break
        end = begin + int(length)
        text += line[: head.start()] + b"#%d" % len(blocks)
        blocks.append(line[begin:end])
        line = line[end:]
    return text + line, blocks


class LineInstrument(ServedInstrument, ABC):
    """An instrument on a TCP port of its own; `_line` answers.

    `at_once` is False where `_line` waits for time to pass.
    """

    protocol: ClassVar[str] = "ascii"
    resource: ClassVar[str] = "socket://{host}:{port}"
    line_end: ClassVar[bytes] = b"\n"
    at_once: ClassVar[bool] = True
    longest_line: ClassVar[int] = MAX_LINE
    takes_blocks: ClassVar[bool] = False
    busy_s: float = 0.0
    """How long after a line its answer goes out."""

    def begin_to_serve(
        self, setting: Setting, lock: AbstractContextManager[object] | None = None
    ) -> None:
        """Listen from now on; each line is answered while `lock`, or the world's, is held."""
        self._server = self._server_kind()(
            setting.name,
            setting.port,
            setting.clock,
            lock or setting.world.lock,
            self._line,
            setting.faults,
            end=self.line_end,
            at_once=self.at_once,
            longest=self.longest_line,
            too_long=self._too_long,
            blocks=self.takes_blocks,
            busy_s=self.busy_s,
        )
        self._server.begin()

    def _server_kind(self) -> Callable[..., LineServer]:
        """Return what makes the server of the port."""
        return LineServer

    @abstractmethod
    def _line(self, line: bytes) -> bytes:
        """Return the answer to a line, with its end; nothing where the instrument says nothing."""

    def _too_long(self) -> bytes:
        """Return the answer to a line that does not fit into the instrument's input."""
        return b""


@contextmanager
def released(lock: AbstractContextManager[object]) -> Iterator[None]:
    """Be outside a lock that is held once, and come back to it."""
    lock.__exit__(None, None, None)
    try:
        yield
    finally:
        lock.__enter__()
