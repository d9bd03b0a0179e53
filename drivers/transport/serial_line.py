"""Text messages over a serial port, or over the TCP port of a serial server, by exchanges."""

from __future__ import annotations

from drivers.transport.retry import NEVER, Repeatable
from drivers.transport.serial_port import Port, SerialSettings, open_port, wire_address
from drivers.transport.text_line import TextLine
from station.roles import Place


class SerialLine(TextLine):
    """One instrument's line of text on a serial port.

    Where the instrument takes an empty line for nothing (`ignores_empty`), one is sent when the
    line is opened anew: it ends whatever half of a request may still stand there.
    """

    when_silent = "check that the instrument is on, its cable is seated, and the baud rate"
    when_wrong = "check the cable, the baud rate, and that nobody else talks to the instrument"

    def __init__(
        self,
        place: Place,
        framing: SerialSettings,
        *,
        request_end: str = "\r",
        answer_end: str = "\r\n",
        ignores_empty: bool = False,
        repeatable: Repeatable = NEVER,
        identity: str = "*IDN?",
        pause_s: float = 0.0,
    ) -> None:
        self._framing = framing
        self._ignores_empty = ignores_empty
        self.pause_s = pause_s
        super().__init__(
            place,
            wire_address(place.address),
            request_end=request_end,
            answer_end=answer_end,
            repeatable=repeatable,
            identity=identity,
        )

    def _port_opened(self) -> Port:
        return open_port(self._place.address, self._framing)

    def _greet(self, port: Port) -> None:
        if self._ignores_empty:
            self._send(port, "sent an empty line", self._request_end)
