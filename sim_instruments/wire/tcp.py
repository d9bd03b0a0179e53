"""Sockets on the loopback interface: accepting clients, and letting them go."""

from __future__ import annotations

import os
import select
import socket
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from threading import Lock, Thread

from sim_instruments.faults.instrument import InstrumentFaults
from sim_instruments.faults.lasting import LastingFault, PortGone
from station.clock import Clock, ClockError, ClockStopped

HOST = "127.0.0.1"
FLOOD = b"0" * 65536


class TcpServer(ABC):
    """Accept any number of clients on one port and serve each in a thread of its own.

    With `faults` the port can vanish for a while, and a connection can be dropped.
    """

    def __init__(
        self, name: str, port: int, clock: Clock, faults: InstrumentFaults | None = None
    ) -> None:
        self._name = name
        self._clock = clock
        self._listener = self._bound(port)
        self._listener.listen()
        self.port: int = self._listener.getsockname()[1]
        self._clients: set[socket.socket] = set()
        self._dropped: set[socket.socket] = set()
        self._guard = Lock()
        self._closed = False
        self._later = count(1)
        self._faults = faults
        if faults is not None:
            faults.when_changed(PortGone.kind, self._port_changed)

    @property
    def name(self) -> str:
        """The instrument that is served."""
        return self._name

    @property
    def address(self) -> str:
        """The host and port, as the clock's wires are named."""
        return f"{HOST}:{self.port}"

    def begin(self) -> None:
        """Start to accept clients."""
        Thread(target=self._accept, name=f"{self._name} accept", daemon=True).start()

    @abstractmethod
    def serve(self, client: socket.socket) -> None:
        """Serve one client until it leaves."""

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

    def drop(self, client: socket.socket) -> None:
        """End a connection from this side; what the client still sends is read and forgotten.

        Unread, it would stay in flight, and virtual time would stand still.
        """
        with self._guard:
            self._dropped.add(client)
        with suppress(OSError):
            client.shutdown(socket.SHUT_WR)

    def reset(self, client: socket.socket) -> None:
        """Reset a connection that nobody reads from at the moment."""
        with self._guard:
            self._dropped.add(client)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()

    def flood(self, client: socket.socket, size: int) -> None:
        """Send bytes without an end, in a thread of its own: whoever reads may stop at any time."""

        def send() -> None:
            with suppress(OSError):
                for _ in range(0, size, len(FLOOD)):
                    client.sendall(FLOOD)

        Thread(target=send, name=f"{self._name} flood", daemon=True).start()

    def drop_all(self) -> None:
        """End every connection from this side."""
        with self._guard:
            clients = list(self._clients)
        for client in clients:
            self.drop(client)

    def later(self, delay_s: float, act: Callable[[], None]) -> None:
        """Do something after a while, as a participant of its own."""
        due_s = self._clock.now() + delay_s
        self._clock.repeat(f"{self._name} later {next(self._later):06d}", due_s, act)

    def _port_changed(self, time_s: float, fault: LastingFault | None) -> None:
        assert self._faults is not None
        if fault is None:
            with self._guard, suppress(OSError):
                if not self._closed:
                    self._listener.listen()
                    self.begin()
            return
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._listener = self._bound(self.port)  # so that nobody else takes the port meanwhile
        self.drop_all()
        left_s = fault.end_s - self._clock.now()
        if left_s < float("inf"):
            # Nobody may come by to look whether it is time.
            self.later(max(left_s, 0.0), self._faults.catch_up)

    def _bound(self, port: int) -> socket.socket:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setblocking(False)
        if os.name == "posix":
            # On Windows the same option would let a second server steal the port.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, port))
        except OSError as error:
            listener.close()
            reason = f"{self._name} cannot be served on port {port} of {HOST}: {error.strerror}"
            raise OSError(error.errno, reason) from error
        return listener

    def connected(self) -> list[socket.socket]:
        """Return who is connected, who has come just now included; nobody once it is closed."""
        self._admit(self._listener)
        with self._guard:
            return [] if self._closed else list(self._clients)

    def _accept(self) -> None:
        listener = self._listener
        with suppress(OSError, ValueError):  # it was closed
            while select.select([listener], [], []) and self._admit(listener):
                pass

    def _admit(self, listener: socket.socket) -> bool:
        """Take in all who have connected; return False when the listener is closed."""
        with self._guard:
            while True:
                try:
                    client, _ = listener.accept()
                except BlockingIOError:
                    return True
                except OSError:
                    return False
                if self._closed:
                    client.close()
                    return False
                client.setblocking(True)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                # Long replies must fit: on virtual time a client reads only after the last byte.
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
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
                self._dropped.discard(client)
            client.close()


def is_closed(client: socket.socket) -> bool:
    """Return whether the other side has ended the connection."""
    try:
        readable, _, _ = select.select([client], [], [], 0)
        return bool(readable) and client.recv(1, socket.MSG_PEEK) == b""
    except (OSError, ValueError):
        return True
