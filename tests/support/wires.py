"""A wire whose other end a test holds."""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.kepco.bop import KepcoBop
from drivers.lakeshore.gaussmeter_f71 import LakeshoreF71
from station.clock import RealClock
from station.instruments.opening import InstrumentPlace

NO_ERROR = b'0,"No error"\n'


LIMITS = {"current": 8.0, "voltage": 30.0, "slew": 2.0, "zero_current": 0.02}


@dataclass(frozen=True)
class Pause:
    """Real time in which the server says nothing."""

    seconds: float


HANG_UP = object()


Acts = tuple[Any, ...]
"""Bytes to send, a Pause, or HANG_UP."""


class Wire:
    """A server that does, for its n-th request, the n-th of its acts; the last one for the rest."""

    greeting = b""
    request = re.compile(rb"[^\n]*\n")

    def __init__(self, *acts: Acts) -> None:
        self._acts = acts
        self.requests: list[bytes] = []
        self._ended = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._clients: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept, name="wire", daemon=True)]
        self._threads[0].start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self._clients.append(client)
                serve = threading.Thread(target=self._serve, args=(client,), name="wire client")
                self._threads.append(serve)
                serve.start()

    def _serve(self, client: socket.socket) -> None:
        pending = b""
        with suppress(OSError), client:
            client.sendall(self.greeting)
            while data := client.recv(65536):
                pending += data
                while match := self.request.match(pending):
                    pending = pending[match.end() :]
                    if self.answered_aside(client, match.group()):
                        continue
                    acts = self.acts_for(match.group())
                    self.requests.append(match.group())
                    for act in acts:
                        if act is HANG_UP:
                            client.shutdown(socket.SHUT_RDWR)
                        elif isinstance(act, Pause):
                            self._ended.wait(act.seconds)
                        else:
                            client.sendall(act)

    def acts_for(self, request: bytes) -> Acts:
        """Return what is done for the next request."""
        return self._acts[min(len(self.requests), len(self._acts) - 1)]

    def answered_aside(self, client: socket.socket, request: bytes) -> bool:
        """Answer what belongs to the line and not to the instrument."""
        return False

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for each in (self._listener, *self._clients):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        for thread in self._threads:
            thread.join(5.0)


class KepcoWire(Wire):
    """A supply that always knows who it is; the acts are for everything else."""

    def acts_for(self, request: bytes) -> Acts:
        """Return what is done for the next request."""
        return self._acts[min(len(self.requests), len(self._acts) - 1)]

    def answered_aside(self, client: socket.socket, request: bytes) -> bool:
        aside = request == b"*IDN?\n"
        if aside:
            client.sendall(b"KEPCO,BIT 802E 36-12,H148202,1.15-1.80\n")
        return aside


class Replay(Wire):
    """An instrument that answers as it was recorded; `acts` makes what is sent of an answer.

    The first `numbered` bytes of a request are its number, which its answer bears, too. Bytes that
    are none of the requests are passed over.
    """

    def __init__(
        self, recorded: Mapping[bytes, bytes], acts: Callable[[bytes], Acts], numbered: int = 0
    ) -> None:
        self._acts_of = acts
        self._answers = {asked[numbered:]: answer[numbered:] for asked, answer in recorded.items()}
        asked = b"|".join(map(re.escape, sorted(self._answers, key=len, reverse=True)))
        self.request = re.compile(rb"(?s:.*?(.{%d}))(%s)" % (numbered, asked))
        super().__init__()

    def acts_for(self, request: bytes) -> Acts:
        number, asked = self.request.fullmatch(request).groups()  # type: ignore[union-attr]
        return self._acts_of(number + self._answers[asked])


@contextmanager
def no_thread_left() -> Iterator[None]:
    """Prove that what is done inside leaves no thread behind."""
    before = set(threading.enumerate())
    yield
    for thread in set(threading.enumerate()) - before:
        thread.join(3.0)
    left = {thread.name for thread in set(threading.enumerate()) - before}
    assert not left, left


@pytest.fixture(autouse=True)
def no_thread_is_left() -> Iterator[None]:
    with no_thread_left():
        yield


def line_to(wire: Wire) -> str:
    return f"TCPIP::127.0.0.1::{wire.port}::SOCKET"


def supply(wire: Wire) -> KepcoBop:
    settings = {"coil_constant": "0.3 mT/A"}
    return KepcoBop(InstrumentPlace("coil_supply.x", line_to(wire), RealClock(), settings, LIMITS))


def gaussmeter(wire: Wire) -> LakeshoreF71:
    settings = {"averaging": "100 ms", "timestamp": "interval-end"}
    return LakeshoreF71(InstrumentPlace("gaussmeter", line_to(wire), RealClock(), settings))
