"""Text messages over a serial port, or over the TCP port of a serial server, by exchanges."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from drivers.roles import Place
from drivers.transport.serial_port import (
    Framing,
    Port,
    SocketPort,
    framing_of,
    one_line,
    open_port,
    wire_address,
)
from station.errors import InstrumentError, InstrumentTimeout

EXCHANGE_DEADLINE_S = 0.5
QUIET_S = 0.1
"""A line on which nothing has come for this run time has nothing more on its way."""

QUIET_LOOKS = 10
LARGEST_ANSWER_BYTES = 1 << 20
ENCODING = "ascii"


class SerialLine:
    """One instrument's line; ends of lines are stripped from answers and added to requests.

    Settings that a bench file may give: `baud_rate`, `data_bits`, `parity` (N, E, O), `stop_bits`,
    `hardware_handshake`; `framing` holds the instrument's own. After an exchange that failed the
    port is opened anew and the line read until it is quiet, so that no late answer is taken for the
    next. Where the instrument takes an empty line for nothing (`ignores_empty`), one is sent first:
    it ends whatever half of a request may still stand there.
    """

    def __init__(
        self,
        place: Place,
        framing: Framing,
        *,
        request_end: str = "\r",
        answer_end: str = "\r\n",
        ignores_empty: bool = False,
    ) -> None:
        self._place = place
        self._clock = place.clock
        self._trace = place.trace
        self._framing = framing_of(place, framing)
        self._request_end = request_end.encode(ENCODING)
        self._answer_end = answer_end.encode(ENCODING)
        self._ignores_empty = ignores_empty
        self._lock = place.clock.lock(place.name)
        self._wire = place.clock.wire(wire_address(place.address))
        self._port: Port | None = None
        self._opened = 0
        self._open()

    def query(self, message: str, deadline_s: float = EXCHANGE_DEADLINE_S) -> str:
        """Send `message` and return the answer without its end.

        Raises InstrumentTimeout when no complete answer comes within `deadline_s` of run time.
        """
        with self._lock:
            port = self._ready()
            try:
                self._write(port, message)
                answer = self._read(port, message, deadline_s)
                self._wire.received()
                return answer
            except BaseException:  # whoever comes next must not read this answer as its own
                self._disconnect()
                raise

    def write(self, message: str) -> None:
        """Send `message`, for commands that have no answer, nor a query to send with them."""
        with self._lock:
            self._write(self._ready(), message)

    def close(self) -> None:
        """Close the line; a line that is already gone is no error."""
        if self._port is not None:
            self._traced("-", b"closed")
        self._disconnect()

    def _ready(self) -> Port:
        """Return the port, opened again after a fault; what came unasked is read and forgotten."""
        port = self._port if self._port is not None else self._open()
        with self._breaks("looked for what had come unasked"):
            self._forget(port)
        return port

    def _open(self) -> Port:
        attempted = f"open {self._place.address}"
        port: Port | None = None
        try:
            port = open_port(self._place.address, self._framing)
            self._wire.open()
            self._opened += 1
            self._traced("-", b"opened" if self._opened == 1 else b"reopened")
            if self._opened > 1 or not isinstance(port, SocketPort):
                self._resynchronise(port)
        except (OSError, ValueError) as error:
            self._wire.close()
            if port is not None:
                port.close()
            raise self._fault(
                InstrumentError,
                attempted,
                f"nobody answers there ({one_line(error)})",
                "switch the instrument on, check its cable and the address in the bench file",
            ) from error
        except BaseException:
            self._wire.close()
            if port is not None:
                port.close()
            raise
        self._port = port
        return port

    def _resynchronise(self, port: Port) -> None:
        """Read until nothing has come for a while; a line that never stops is read on all the same.

        What then still comes is no answer to anything, and is told as such.
        """
        if self._ignores_empty:
            self._wire.sent(len(self._request_end))
            self._traced(">", self._request_end)
            port.write(self._request_end)
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

    def _write(self, port: Port, message: str) -> None:
        sent = message.encode(ENCODING) + self._request_end
        with self._breaks(f"sent {shortened(message)!r}"):
            self._wire.sent(len(sent))
            self._traced(">", sent)
            port.write(sent)

    def _read(self, port: Port, message: str, deadline_s: float) -> str:
        """Return the answer, which is complete with its end."""
        attempted = f"sent {shortened(message)!r}"
        answer = b""
        if not self._wire.wait(self._clock.now() + deadline_s):
            with self._breaks(attempted):
                self._forget(port)
            raise self._silent(attempted, "no answer came", deadline_s)
        until_s = self._clock.now() + self._clock.patience_s(deadline_s)
        left_s = deadline_s
        try:
            with self._breaks(attempted):
                while not self._is_whole(answer) and left_s > 0:
                    came = port.read(self._clock.real_timeout_s(left_s))
                    answer += came
                    if len(answer) > LARGEST_ANSWER_BYTES or not came:
                        break
                    left_s = until_s - self._clock.now()
        finally:
            if answer:
                self._traced("<", answer)
        if not answer:
            raise self._silent(attempted, "no answer came", deadline_s)
        text = answer.decode(ENCODING, "backslashreplace")
        if not answer.isascii():
            raise self._wrong(attempted, f"{shortened(text)!r} came back, which is no text")
        if not self._is_whole(answer):
            what = f"only {shortened(text)!r} came, without the end of an answer,"
            raise self._silent(attempted, what, deadline_s)
        return self._unwrapped(attempted, text)

    def _is_whole(self, answer: bytes) -> bool:
        """Return whether an answer is complete, or so odd that there is nothing to wait for."""
        return answer.endswith(self._answer_end)

    def _unwrapped(self, attempted: str, text: str) -> str:
        """Return a complete answer without its end; InstrumentError where it is more than one."""
        end = self._answer_end.decode(ENCODING)
        text = text.removesuffix(end)
        if end in text:
            raise self._wrong(attempted, f"{shortened(text)!r} came back, more than one answer")
        return text

    def _traced(self, direction: str, data: bytes) -> None:
        if self._trace is not None:
            self._trace(direction, data)

    def _fault(
        self, kind: type[InstrumentError], attempted: str, came_back: str, do_now: str
    ) -> InstrumentError:
        self._traced("!", f"{attempted}: {came_back}".encode())
        return kind(self._place.name, attempted, came_back, do_now)

    def _silent(self, attempted: str, what: str, deadline_s: float) -> InstrumentError:
        return self._fault(
            InstrumentTimeout,
            attempted,
            f"{what} within {deadline_s:g} s",
            "check that the instrument is on, its cable is seated, and the baud rate",
        )

    def _wrong(self, attempted: str, came_back: str) -> InstrumentError:
        return self._fault(
            InstrumentError,
            attempted,
            came_back,
            "check the cable, the baud rate, and that nobody else talks to the instrument",
        )

    @contextmanager
    def _breaks(self, attempted: str) -> Iterator[None]:
        """Tell an OSError inside as a line that broke, which is then closed."""
        try:
            yield
        except OSError as error:
            self._disconnect()
            raise self._fault(
                InstrumentError,
                attempted,
                f"the line broke ({one_line(error)})",
                "check the cable and the instrument's power, then start again",
            ) from error


def shortened(text: str, longest: int = 60) -> str:
    """Return `text`, its middle left out when it is long."""
    return text if len(text) <= longest else f"{text[: longest // 2]}…{text[-longest // 2 :]}"
