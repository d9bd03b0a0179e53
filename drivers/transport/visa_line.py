"""Text messages over VISA: a request and its answer as one exchange."""

from __future__ import annotations

from collections.abc import Callable

from drivers.transport.line import number_of, shortened
from drivers.transport.retry import NEVER, Repeatable
from drivers.transport.serial_port import Port
from drivers.transport.text_line import TextLine
from drivers.transport.visa_port import visa_port, wire_address
from station.errors import InstrumentError
from station.roles import Place


class VisaLine(TextLine):
    """One instrument's line at a VISA resource.

    An answer is complete with the last character of `answer_end`.
    """

    when_silent = "check that the instrument is on, in remote mode, and its cable is seated"
    when_wrong = (
        "check the cable, that nobody else talks to the instrument, and the baud rate where the "
        "line is serial"
    )

    def __init__(
        self,
        place: Place,
        *,
        request_end: str = "\n",
        answer_end: str = "\n",
        repeatable: Repeatable = NEVER,
        identity: str = "*IDN?",
    ) -> None:
        self._before_end = answer_end[:-1]
        super().__init__(
            place,
            wire_address(place.address),
            request_end=request_end,
            answer_end=answer_end[-1:],
            repeatable=repeatable,
            identity=identity,
        )

    def _port_opened(self) -> Port:
        return visa_port(self._place, self._before_end + self._answer_end.decode("ascii"))

    def _needs_quiet(self, port: Port) -> bool:
        return False  # a fresh connection has no late answers

    def _unwrapped(self, attempted: str, text: str) -> str:
        return super()._unwrapped(attempted, text).removesuffix(self._before_end)


class ScpiLine(VisaLine):
    """A VISA line whose instrument keeps an error queue that is asked in the same message.

    `error_query` is appended to each command; `no_error(answer)` tells an empty queue.
    """

    def __init__(
        self,
        place: Place,
        *,
        error_query: str,
        no_error: Callable[[str], bool],
        answer_end: str = "\n",
        repeatable: Repeatable = NEVER,
    ) -> None:
        super().__init__(place, answer_end=answer_end, repeatable=repeatable)
        self._error_query = error_query
        self._no_error = no_error

    def command(self, message: str) -> None:
        """Send a command and read the error queue in one exchange; a refusal is InstrumentError."""
        answer = self.query(f"{message};{self._error_query}")
        if not self._no_error(answer):
            raise self.refused(message, answer)

    def refused(self, message: str, answer: str) -> InstrumentError:
        """Return the error of a command that the instrument refused with `answer`."""
        return InstrumentError(
            self._place.name,
            f"sent {shortened(message)!r}",
            f"it refused with {shortened(answer)}",
            "compare the plan's and the bench file's values with the instrument's ranges",
        )

    def number(self, message: str) -> float:
        """Return the answer to `message` as a finite number; anything else is InstrumentError."""
        return number_of(self._place.name, message, self.query(message))
