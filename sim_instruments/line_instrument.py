"""What every simulated instrument that answers lines does alike: serve, and say where."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, ClassVar

from sim_instruments.instrument import Setting
from sim_instruments.tcp import HOST, LineServer


class LineInstrument:
    """An instrument on a TCP port of its own; its class says which, and `_line` answers.

    `resource` is the form of the address that a driver of it takes.
    """

    model: ClassVar[str]
    protocol: ClassVar[str] = "scpi"
    resource: ClassVar[str] = "TCPIP::{host}::{port}::SOCKET"
    line_end: ClassVar[bytes] = b"\n"

    def begin_to_serve(
        self, setting: Setting, lock: AbstractContextManager[object] | None = None
    ) -> None:
        """Listen from now on; each line is answered while `lock`, or the world's, is held."""
        self._server = LineServer(
            setting.name,
            setting.port,
            setting.clock,
            lock or setting.world.lock,
            self._line,
            setting.faults,
            end=self.line_end,
        )
        self._server.begin()

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        port = self._server.port
        return {
            "model": self.model,
            "protocol": self.protocol,
            "address": self.resource.format(host=HOST, port=port),
            "host": HOST,
            "port": port,
        }

    def close(self) -> None:
        """Stop serving."""
        self._server.close()

    def _line(self, line: bytes) -> bytes:
        """Return the answer to a line, with its end; nothing where the instrument says nothing."""
        raise NotImplementedError
