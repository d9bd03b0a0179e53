"""A partner on the loopback interface that does not behave: silent, garbled, gone, or late."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from urllib.parse import urlsplit

from station.clock import Clock, ClockStopped

HOST = "127.0.0.1"
JOIN_S = 5.0
Answer = Callable[[bytes], bytes | None]
"""What comes back for the bytes received: bytes, nothing (b""), or None to hang up."""


class FaultyServer:
    """Answer every request of every client as `answer` says; `can` speaks as socketcand does.

    It counts what it takes off the wire, so that on virtual time its silence costs run time only.
    `answer` may sleep on the clock. `greets` False keeps even the greeting of a CAN daemon back.
    """

    def __init__(
        self, clock: Clock, answer: Answer, *, can: bool = False, greets: bool = True
    ) -> None:
        self._answer, self._can, self._greets = answer, can, greets
        self._listener = socket.create_server((HOST, 0))
        self.port: int = self._listener.getsockname()[1]
        self.received = b""
        self._wire = clock.wire(f"{HOST}:{self.port}")
        self._clients: list[socket.socket] = []
        self._threads = [Thread(target=self._accept, name="faulty server", daemon=True)]
        self._threads[0].start()

    def close(self) -> None:
        """Hang up and stop listening."""
        for each in (self._listener, *self._clients):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        for thread in self._threads:
            thread.join(JOIN_S)

    def __enter__(self) -> FaultyServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self._clients.append(client)
                args = (client,)
                thread = Thread(target=self._serve, args=args, name="faulty client", daemon=True)
                self._threads.append(thread)
                thread.start()

    def _serve(self, client: socket.socket) -> None:
        with suppress(OSError, ClockStopped), client:
            if self._can and self._greets:
                client.sendall(b"< hi >")
            while data := client.recv(65536):
                self.received += data
                units = data.count(b"< send ") if self._can else len(data)
                if not units:
                    if self._greets:
                        client.sendall(b"< ok >")
                    continue
                with self._wire.serving(units):
                    reply = self._answer(data)
                    if reply is None:
                        client.shutdown(socket.SHUT_RDWR)
                        return
                    client.sendall(reply)
                    if not self._can:
                        self._wire.answered(len(reply))


def closed_port() -> int:
    """Return a port of the loopback interface on which nobody listens."""
    with socket.create_server((HOST, 0)) as free:
        port: int = free.getsockname()[1]
    return port


def is_can(address: str) -> bool:
    """Whether an address is a bus behind socketcand."""
    return address.startswith("socketcand://")


def moved_to(address: str, port: int) -> str | None:
    """Return an address of the same kind at `port` of this computer; None where there is none."""
    parts = address.split("::")
    if len(parts) == 4 and parts[-1].upper() == "SOCKET":
        return f"{parts[0]}::{HOST}::{port}::SOCKET"
    split = urlsplit(address)
    if split.scheme in ("socketcand", "socket", "modbus-tcp"):
        return split._replace(netloc=f"{HOST}:{port}").geturl()
    return None
