"""Sockets on the loopback interface: accepting clients, and instruments that speak in lines."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from threading import Lock, Thread

from station.clock import Clock, ClockError, ClockStopped

HOST = "127.0.0.1"
LONGEST_LINE = 65536


class TcpServer:
    """Accept any number of clients on one port and serve each in a thread of its own."""

    def __init__(self, name: str, port: int) -> None:
        self._name = name
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        if os.name == "posix":
            # On Windows the same option would let a second server steal the port.
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((HOST, port))
            self._listener.listen()
        except OSError as error:
            self._listener.close()
            told = f"{name} cannot be served on port {port} of {HOST}: {error.strerror}"
            raise OSError(error.errno, told) from error
        self.port: int = self._listener.getsockname()[1]
        self._clients: set[socket.socket] = set()
        self._guard = Lock()
        self._closed = False

    @property
    def address(self) -> str:
        """The host and port, as the clock's wires are named."""
        return f"{HOST}:{self.port}"

    def begin(self) -> None:
        """Start to accept clients."""
        Thread(target=self._accept, name=f"{self._name} accept", daemon=True).start()

    def serve(self, client: socket.socket) -> None:
        """Serve one client until it leaves."""
        raise NotImplementedError

    def close(self) -> None:
        """Close the port and all connections."""
        with self._guard:
            self._closed = True
            clients = list(self._clients)
        for each in (self._listener, *clients):
            # Without a shutdown a thread that waits in accept or recv would go on waiting.
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # Long replies must fit: on virtual time a client reads only after the last byte.
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
            with self._guard:
                if self._closed:
                    client.close()
                    return
                self._clients.add(client)
            Thread(
                target=self._serve, args=(client,), name=f"{self._name} client", daemon=True
            ).start()

    def _serve(self, client: socket.socket) -> None:
        try:
            self.serve(client)
        except (OSError, ClockStopped, ClockError):
            pass
        finally:
            with self._guard:
                self._clients.discard(client)
            client.close()


class LineServer(TcpServer):
    """Pass each line to an instrument and send back what it replies."""

    def __init__(
        self,
        name: str,
        port: int,
        clock: Clock,
        lock: AbstractContextManager[object],
        execute: Callable[[bytes], bytes],
    ) -> None:
        super().__init__(name, port)
        self._wire = clock.wire(self.address)
        self._lock = lock
        self._execute = execute

    def serve(self, client: socket.socket) -> None:
        """Read lines ended by LF until the client leaves."""
        pending = b""
        while data := client.recv(65536):
            with self._wire.serving(len(data)):
                *lines, pending = (pending + data).split(b"\n")
                if len(pending) > LONGEST_LINE:
                    pending = pending[:LONGEST_LINE]
                for line in lines:
                    with self._lock:
                        reply = self._execute(line)
                    if reply:
                        client.sendall(reply)
                        self._wire.answered(len(reply))
