"""What every simulated instrument that answers lines does alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from typing import ClassVar

from sim_instruments.instrument import ServedInstrument, Setting
from sim_instruments.wire.requests import LineServer


class LineInstrument(ServedInstrument, ABC):
    """An instrument on a TCP port of its own; `_line` answers.

    `at_once` is False where `_line` waits for time to pass.
    """

    protocol: ClassVar[str] = "scpi"
    resource: ClassVar[str] = "TCPIP::{host}::{port}::SOCKET"
    line_end: ClassVar[bytes] = b"\n"
    at_once: ClassVar[bool] = True

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
            at_once=self.at_once,
        )
        self._server.begin()

    @abstractmethod
    def _line(self, line: bytes) -> bytes:
        """Return the answer to a line, with its end; nothing where the instrument says nothing."""
