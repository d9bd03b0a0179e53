"""Open an instrument's driver against nobody, so that all it loads is in memory before it counts.

Drivers and the libraries below them load parts of themselves when they are first used. When that
is in a take-over, the disk that holds them may not answer.
"""

from __future__ import annotations

import re
import socket
from contextlib import suppress
from threading import Thread

from station.clock import RealClock
from station.guardian.reopening import Opening
from station.instruments.bench import Bench

REHEARSES_WITHIN_S = 2.0
"""Less than a guardian may be silent: an instrument may come to be watched late."""
RESOURCE = re.compile(r"tcpip\d*::.*", re.IGNORECASE)
URL = re.compile(r"(?P<scheme>[a-z-]+)://[^/]+(?P<path>.*)", re.IGNORECASE)


def rehearse(name: str, bench: Bench, address: str) -> None:
    """Open an instrument where its network address would be, on this computer, and fail.

    Nothing is sent to any instrument. Other kinds of line are left alone: what they need is
    loaded with their driver.
    """
    nobody = Nobody()
    with suppress(OSError, UnicodeError):  # what names of hosts are looked up with, too
        socket.getaddrinfo("localhost", None)
    if instead := at_port(address, nobody.port):
        Opening(name, bench, {name: instead}, RealClock()).wait(REHEARSES_WITHIN_S)
    nobody.leave()


def at_port(address: str, port: int) -> str | None:
    """Return an address of the same kind at a port of this computer, None for other kinds."""
    if RESOURCE.fullmatch(address):
        return f"TCPIP::127.0.0.1::{port}::SOCKET"
    if found := URL.fullmatch(address):
        return f"{found['scheme']}://127.0.0.1:{port}{found['path']}"
    return None


class Nobody:
    """Whoever connects finds the line closed at once."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        Thread(target=self._close_all, name="nobody", daemon=True).start()

    def leave(self) -> None:
        """Listen no more."""
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()

    def _close_all(self) -> None:
        with suppress(OSError):
            while True:
                self._listening.accept()[0].close()
