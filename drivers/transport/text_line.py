"""Lines of text over a port: a request and its answer as one exchange, and who answers."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from drivers.transport.exchange_port import ExchangePort
from drivers.transport.line import number_of, shortened
from drivers.transport.retry import NEVER, Repeatable
from drivers.transport.serial_port import Port, SerialSettings, open_port, wire_address
from station.errors import InstrumentError
from station.roles import Place

ENCODING = "ascii"
LEARN_TRIES = 3


class TextLine(ExchangePort):
    """One instrument's line; ends of lines are stripped from answers and added to requests.

    `identity` is the question whose answer no other question has: the answer that it got last is
    what `echoes_identity` compares with.
    """

    def __init__(
        self,
        place: Place,
        wire: str,
        *,
        request_end: str,
        answer_end: str,
        repeatable: Repeatable = NEVER,
        identity: str = "*IDN?",
        deadlines: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._request_end = request_end.encode(ENCODING)
        self._answer_end = answer_end.encode(ENCODING)
        self._identity_question = identity
        self._identity: str | None = None
        super().__init__(place, wire, repeatable, deadlines)

    def query(self, message: str, *, now: bool = False) -> str:
        """Send `message` and return the answer without its end.

        Raises InstrumentTimeout when no complete answer comes within the deadline of its kind, and
        TooLate, with nothing sent, where one that is due `now` meets a line out of step.
        """
        return self.patiently(message, lambda: self._answer(message, now), now=now)

    def number(self, message: str) -> float:
        """Return the answer to `message` as a finite number; anything else is InstrumentError."""
        return self.patiently(
            message, lambda: number_of(self._place.name, message, self.query(message))
        )

    def write(self, message: str) -> None:
        """Send `message`, which has no answer; whatever lies on the line, it is sent."""
        self._blindly(lambda port: self._write(port, message))

    def last_attempt(self, message: str) -> None:
        """Send `message` where no answer can be understood, and leave the time to hear it."""
        self._attempt(lambda port: self._write(port, message), message)

    def echoes_identity(self) -> bool:
        """Ask who is there; whether it is who answered before, so that the line is in step.

        Who was never asked is asked until the same comes twice.
        """
        for _ in range(LEARN_TRIES):
            if self._identity is not None:
                break
            who = self._who()
            if any(map(str.isalpha, who)) and who == self._who():
                self._identity = who
        return self._identity is not None and self._who() == self._identity

    def _doubt(self, came: bytes, asked: str) -> None:
        if asked == self._identity_question:
            self._identity = None  # what was taken for it may have been anything
        super()._doubt(came, asked)

    def _who(self) -> str:
        question = self._identity_question
        return self._exchange(question, lambda port: self._once(port, question))

    def _answer(self, message: str, now: bool) -> str:
        answer = self._exchange(message, lambda port: self._once(port, message), now=now)
        if message == self._identity_question and any(map(str.isalpha, answer)):
            self._identity = answer
        return answer

    def _once(self, port: Port, message: str) -> str:
        self._write(port, message)
        return self._read(port, message, self.deadline_of_s(message))

    def _prove(self, port: Port) -> None:
        if self._identity is None:
            return
        answer = self._once(port, self._identity_question)
        if answer != self._identity:
            raise self._wrong(
                f"asked {self._identity_question!r} to bring the line into step",
                f"{shortened(answer)!r} came back instead of {shortened(self._identity)!r}",
            )

    def _settle(self, port: Port, message: str, answer: object) -> None:
        """Ask again what the last message was, where that does no harm.

        What a command is answered must be the same again. What was measured never is: that the
        reading is in doubt stands in the run's log.
        """
        super()._settle(port, message, answer)
        if not only_asks(message):
            try:
                again = self._once(port, message)
            except InstrumentError as error:
                again = str(error)
            if again != answer:
                raise self._wrong(
                    f"sent {shortened(message)!r}",
                    f"{shortened(str(answer))!r} came back, and {shortened(again)!r} when asked "
                    "again",
                )

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
        return self._answer_end in answer

    def _unwrapped(self, attempted: str, text: str) -> str:
        """Return a complete answer without its end; AnswerInDoubt where it is more than one."""
        answer, _, behind = text.partition(self._answer_end.decode(ENCODING))
        if behind:
            self._doubt(text.encode(ENCODING), attempted)
            came_back = f"{shortened(text)!r} came back, more than one answer"
            raise self._doubtful(attempted, came_back)
        return answer


def only_asks(message: str) -> bool:
    """Whether a message consists of questions alone."""
    return all(command.partition(" ")[0].endswith("?") for command in message.split(";"))


class SerialLine(TextLine):
    """One instrument's line of text on a serial port, or on the TCP port of a serial server.

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
        deadlines: Mapping[str, float] = MappingProxyType({}),
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
            deadlines=deadlines,
        )

    def _port_opened(self) -> Port:
        return open_port(self._place.address, self._framing)

    def _greet(self, port: Port) -> None:
        if self._ignores_empty:
            self._send(port, "sent an empty line", self._request_end)
