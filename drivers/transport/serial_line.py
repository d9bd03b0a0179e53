"""Text messages over a serial port, or over the TCP port of a serial server, by exchanges."""

from __future__ import annotations

from drivers.roles import Place
from drivers.transport.exchange_port import EXCHANGE_DEADLINE_S, ExchangePort
from drivers.transport.serial_port import Framing, Port, framing_of, open_port, wire_address

ENCODING = "ascii"


class SerialLine(ExchangePort):
    """One instrument's line; ends of lines are stripped from answers and added to requests.

    Settings that a bench file may give: `baud_rate`, `data_bits`, `parity` (N, E, O), `stop_bits`,
    `hardware_handshake`; `framing` holds the instrument's own. Where the instrument takes an empty
    line for nothing (`ignores_empty`), one is sent when the line is opened anew: it ends whatever
    half of a request may still stand there.
    """

    when_silent = "check that the instrument is on, its cable is seated, and the baud rate"
    when_wrong = "check the cable, the baud rate, and that nobody else talks to the instrument"

    def __init__(
        self,
        place: Place,
        framing: Framing,
        *,
        request_end: str = "\r",
        answer_end: str = "\r\n",
        ignores_empty: bool = False,
    ) -> None:
        self._framing = framing_of(place, framing)
        self._request_end = request_end.encode(ENCODING)
        self._answer_end = answer_end.encode(ENCODING)
        self._ignores_empty = ignores_empty
        super().__init__(place, wire_address(place.address))

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

    def _port_opened(self) -> Port:
        return open_port(self._place.address, self._framing)

    def _greet(self, port: Port) -> None:
        if self._ignores_empty:
            self._send(port, "sent an empty line", self._request_end)

    def _write(self, port: Port, message: str) -> None:
        sent = message.encode(ENCODING) + self._request_end
        self._send(port, f"sent {shortened(message)!r}", sent)

    def _read(self, port: Port, message: str, deadline_s: float) -> str:
        """Return the answer, which is complete with its end."""
        attempted = f"sent {shortened(message)!r}"
        answer = self._receive(port, attempted, deadline_s, self._is_whole)
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


def shortened(text: str, longest: int = 60) -> str:
    """Return `text`, its middle left out when it is long."""
    return text if len(text) <= longest else f"{text[: longest // 2]}…{text[-longest // 2 :]}"
