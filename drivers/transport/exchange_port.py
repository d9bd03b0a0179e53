"""A port over which exchanges go one at a time: opened anew after a fault, and read until quiet."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress

from drivers.roles import Place
from drivers.transport.serial_port import Port, SocketPort, one_line
from drivers.transport.traced import TracedLine
from station.errors import InstrumentError, InstrumentTimeout

EXCHANGE_DEADLINE_S = 0.5
QUIET_S = 0.1
"""A line on which nothing has come for this run time has nothing more on its way."""

QUIET_LOOKS = 10
LARGEST_ANSWER_BYTES = 1 << 20


class ExchangePort(TracedLine, ABC):
    """What a line of exchanges does whatever its messages look like.

    `wire` is the address of its counting. After an exchange that failed the port is opened anew and
    read until it is quiet, so that no late answer is taken for the next.
    """

    when_silent = "check that the instrument is on, and its cable"
    when_wrong = "check the cable, and that nobody else talks to the instrument"

    def __init__(self, place: Place, wire: str) -> None:
        super().__init__(place)
        self._lock = place.clock.lock(f"{place.name} line")
        self._wire = place.clock.wire(wire)
        self._port: Port | None = None
        self._opened = 0
        self._open()

    def close(self) -> None:
        """Close the line; one that is already gone is no error."""
        if self._port is not None:
            self._traced("-", b"closed")
        self._disconnect()

    @abstractmethod
    def _port_opened(self) -> Port:
        """Open the port; raises OSError or ValueError."""

    def _greet(self, port: Port) -> None:
        """Send what a line that is opened anew needs before it is read until quiet."""

    def _ready(self) -> Port:
        """Return the port, opened again after a fault; what came unasked is read and forgotten."""
        port = self._port if self._port is not None else self._open()
        try:
            self._forget(port)
        except OSError as error:
            raise self._broken("looked for what had come unasked", error) from error
        return port

    def _open(self) -> Port:
        port: Port | None = None
        try:
            port = self._port_opened()
            self._wire.open()
            self._opened += 1
            self._traced("-", b"opened" if self._opened == 1 else b"reopened")
            if self._opened > 1 or not isinstance(port, SocketPort):
                self._greet(port)
                self._await_quiet(port)
        except BaseException as error:
            self._wire.close()
            if port is not None:
                port.close()
            if not isinstance(error, OSError | ValueError):
                raise
            raise self._nobody_answers(one_line(error)) from error
        self._port = port
        return port

    def _await_quiet(self, port: Port) -> None:
        """Read until nothing has come for a while; a line that never stops is read on all the same.

        What then still comes is no answer to anything, and is told as such.
        """
        for _ in range(QUIET_LOOKS):
            self._clock.sleep(QUIET_S)
            if not self._forget(port):
                return

    def _forget(self, port: Port) -> bool:
        """Read what has come and forget it; return whether there was anything."""
        found = False
        while data := port.read(0.0):
            found = True
            self._traced("<", data)
            self._traced("-", b"not asked for, forgotten")
        if found:
            self._wire.received()
        return found

    def _disconnect(self) -> None:
        self._wire.close()
        port, self._port = self._port, None
        if port is not None:
            with suppress(OSError):
                port.close()

    def _send(self, port: Port, attempted: str, data: bytes) -> None:
        try:
            self._wire.sent(len(data))
            self._traced(">", data)
            port.write(data)
        except OSError as error:
            raise self._broken(attempted, error) from error

    def _receive(
        self, port: Port, attempted: str, deadline_s: float, is_whole: Callable[[bytes], bool]
    ) -> bytes:
        """Return what came until it was whole, or until no more did; never nothing.

        Raises InstrumentTimeout where nothing comes.
        """
        if not self._wire.wait(self._clock.now() + deadline_s):
            try:
                self._forget(port)
            except OSError as error:
                raise self._broken(attempted, error) from error
            raise self._silent(attempted, "no answer came", deadline_s)
        until_s = self._clock.now() + self._clock.patience_s(deadline_s)
        left_s, answer = deadline_s, b""
        try:
            while left_s > 0:
                came = port.read(self._clock.real_timeout_s(left_s))
                answer += came
                if not came or is_whole(answer) or len(answer) > LARGEST_ANSWER_BYTES:
                    break
                left_s = until_s - self._clock.now()
        except OSError as error:
            raise self._broken(attempted, error) from error
        finally:
            if answer:
                self._traced("<", answer)
        if not answer:
            raise self._silent(attempted, "no answer came", deadline_s)
        return answer

    def _silent(self, attempted: str, what: str, deadline_s: float) -> InstrumentError:
        said = f"{what} within {deadline_s:g} s"
        return self._fault(attempted, said, self.when_silent, InstrumentTimeout)

    def _wrong(self, attempted: str, came_back: str) -> InstrumentError:
        return self._fault(attempted, came_back, self.when_wrong)

    def _broken(self, attempted: str, error: OSError) -> InstrumentError:
        """Close the line, which broke, and return the error that tells it."""
        self._disconnect()
        return self._fault(
            attempted,
            f"the line broke ({one_line(error)})",
            "check the cable and the instrument's power, then start again",
        )
