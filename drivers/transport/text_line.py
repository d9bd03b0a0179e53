"""Lines of text and SCPI: a request and its answer, who answers, and what answers say."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from itertools import islice
from types import MappingProxyType
from typing import ClassVar, TypedDict, TypeVar, Unpack

from pydantic import Field

from drivers.transport.exchanges import NEVER, ExchangeLine, Repeatable, shortened
from drivers.transport.ports import Attachment, Port, SerialSettings, serial_port, visa_resource
from station.errors import AnotherInstrument, InstrumentError
from station.roles import Driver, DriverSettings, Identity, Place

Value = TypeVar("Value")

ENCODING = "ascii"
LEARN_TRIES = 3
ERROR_QUERY = ":SYST:ERR?"
NO_ERROR = r"\+?0,"
OTHER_ADDRESS = "check that the address in the bench file is its own"
MAX_KEPT_ERRORS = 100
"""More than any of these instruments keeps."""


class Form(TypedDict, total=False):
    """What a line of text may be given besides its ends; see `TextLine`."""

    repeatable: Repeatable
    identity: str
    deadlines: Mapping[str, float]
    pause_s: float
    ignores_empty: bool
    when_odd: str


class TextLine(ExchangeLine):
    """One instrument's line; ends of lines are stripped from answers and added to requests.

    An answer ends with `answer_end`, before which `before_end` may stand. `identity` is the
    question whose answer no other question has: the answer that it got last is what
    `echoes_identity` compares with. Where the instrument takes an empty line for nothing
    (`ignores_empty`), one is sent when the line is opened anew: it ends whatever half of a request
    may still stand there. `pause_s` is the run time that it needs between two messages, `when_odd`
    what to do about an answer that is none.
    """

    def __init__(
        self,
        place: Place,
        attachment: Attachment,
        *,
        request_end: str,
        answer_end: str,
        before_end: str = "",
        repeatable: Repeatable = NEVER,
        identity: str = "*IDN?",
        deadlines: Mapping[str, float] = MappingProxyType({}),
        pause_s: float = 0.0,
        ignores_empty: bool = False,
        when_odd: str = OTHER_ADDRESS,
    ) -> None:
        self._request_end = request_end.encode(ENCODING)
        self._answer_end = answer_end.encode(ENCODING)
        self._before_end = before_end
        self._identity_question = identity
        self._identity: str | None = None
        self.pause_s = pause_s
        self._ignores_empty = ignores_empty
        self._when_odd = when_odd
        super().__init__(place, attachment, repeatable, deadlines)

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

    def numbers(self, message: str) -> list[float]:
        """Return the finite numbers of an answer, between commas; an empty answer has none."""
        answer = self.query(message)
        return numbers_of(self._place.name, message, answer.split(",") if answer else [])

    def answers(self, questions: Mapping[str, Callable[[str], Value]]) -> list[Value]:
        """Ask several questions in one message, each from the root; return what each answer is.

        What reads an answer raises ValueError or KeyError for one that is none.
        """
        message = ";:".join(questions)
        answer = self.query(message)
        try:
            pairs = zip(questions.values(), answer.split(";"), strict=True)
            return [read(text) for read, text in pairs]
        except (ValueError, KeyError):
            raise self.odd(message, answer) from None

    def odd(self, question: str, answer: str) -> InstrumentError:
        """Return the error of an answer that is none."""
        return odd(self._place.name, f"asked {shortened(question)}", answer, self._when_odd)

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
            if self._names(who) and who == self._who():
                self._identity = who
        return self._identity is not None and self._who() == self._identity

    def _names(self, answer: str) -> bool:
        """Whether an answer may be that of the identity: no reading looks like it."""
        return any(map(str.isalpha, answer))

    def _greet(self, port: Port) -> None:
        if self._ignores_empty:
            self._send(port, "sent an empty line", self._request_end)

    def _doubt(self, came: bytes, asked: str) -> None:
        if asked == self._identity_question:
            self._identity = None  # what was taken for it may have been anything
        super()._doubt(came, asked)

    def _who(self) -> str:
        question = self._identity_question
        return self._exchange(question, lambda port: self._once(port, question))

    def _answer(self, message: str, now: bool) -> str:
        answer = self._exchange(message, lambda port: self._once(port, message), now=now)
        if message == self._identity_question and self._names(answer):
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
        """Return a complete answer without its end; AnswerInDoubt where it is more than one."""
        attempted = f"sent {shortened(message)!r}"
        came = self._receive(port, attempted, deadline_s, self._is_whole)
        text = came.decode(ENCODING, "backslashreplace")
        if not came.isascii():
            raise self._wrong(attempted, f"{shortened(text)!r} came back, which is no text")
        if not self._is_whole(came):
            what = f"only {shortened(text)!r} came, without the end of an answer,"
            raise self._silent(attempted, what, deadline_s)
        answer, _, behind = text.partition(self._answer_end.decode(ENCODING))
        padding = self.padding.decode(ENCODING)
        if behind.strip(padding):
            self._doubt(came, attempted)
            came_back = f"{shortened(text)!r} came back, more than one answer"
            raise self._doubtful(attempted, came_back)
        self.padded |= bool(behind) or answer != answer.lstrip(padding)
        return answer.lstrip(padding).removesuffix(self._before_end)

    def _is_whole(self, answer: bytes) -> bool:
        """Return whether an answer is complete, or so odd that there is nothing to wait for."""
        return self._answer_end in answer


def only_asks(message: str) -> bool:
    """Whether a message consists of questions alone."""
    return all(command.partition(" ")[0].endswith("?") for command in message.split(";"))


class SerialLine(TextLine):
    """One instrument's line of text on a serial port, or on the TCP port of a serial server."""

    def __init__(
        self,
        place: Place,
        framing: SerialSettings,
        *,
        request_end: str = "\r",
        answer_end: str = "\r\n",
        **form: Unpack[Form],
    ) -> None:
        port = serial_port(place.address, framing)
        super().__init__(place, port, request_end=request_end, answer_end=answer_end, **form)


class VisaSettings(DriverSettings):
    """The settings of an instrument on a VISA line."""

    visa_library: str = Field(
        "@py", min_length=1, description="path of a vendor's VISA library; `@py` is pyvisa-py"
    )


class VisaLine(TextLine):
    """One instrument's line at a VISA resource, with its error queue where it keeps one.

    An answer is complete with the last character of `answer_end`. `error_query` is appended to each
    command; an empty queue answers with `no_error`, a regular expression.
    """

    def __init__(
        self,
        place: Place,
        *,
        request_end: str = "\n",
        answer_end: str = "\n",
        error_query: str = ERROR_QUERY,
        no_error: str = NO_ERROR,
        **form: Unpack[Form],
    ) -> None:
        self._error_query = error_query
        self._no_error = re.compile(no_error)
        library = VisaSettings.of(place).visa_library
        super().__init__(
            place,
            visa_resource(place.address, library, answer_end),
            request_end=request_end,
            answer_end=answer_end[-1:],
            before_end=answer_end[:-1],
            **form,
        )

    def command(self, message: str, *, now: bool = False) -> None:
        """Send a command and read the error queue in one exchange; a refusal is InstrumentError.

        One that is due `now` raises TooLate, with nothing sent, where the line is out of step.
        """
        self.patiently(message, lambda: self._command(message, now), now=now)

    def _command(self, message: str, now: bool) -> None:
        answer = self.query(f"{message};{self._error_query}", now=now)
        if not self._no_error.match(answer):
            raise self.refused(message, answer)

    def refused(self, message: str, answer: str) -> InstrumentError:
        """Return the error of a command that the instrument refused with `answer`."""
        return InstrumentError(
            self._place.name,
            f"sent {shortened(message)!r}",
            f"it refused with {shortened(answer)}",
            "compare the plan's and the bench file's values with the instrument's ranges",
        )

    def forget_errors(self) -> None:
        """Empty the queue: what was refused before is no refusal of what follows."""
        self.query(f"*CLS;{self._error_query}")

    def next_error(self) -> str:
        """Take the oldest error, or all, from the queue; empty where there is none."""
        answer = self.query(self._error_query)
        return "" if self._no_error.match(answer) else answer


class ScpiDriver(Driver):
    """A driver of an instrument with `*IDN?` and an error queue, on a `VisaLine`."""

    Settings: ClassVar[type[VisaSettings]] = VisaSettings
    on_can = False
    repeatable: ClassVar[Repeatable] = NEVER
    error_query: ClassVar[str] = ERROR_QUERY
    no_error: ClassVar[str] = NO_ERROR
    answer_end: ClassVar[str] = "\n"
    when_odd: ClassVar[str] = OTHER_ADDRESS

    def __init__(self, place: Place) -> None:
        self.place = place
        self._line = VisaLine(
            place,
            error_query=self.error_query,
            no_error=self.no_error,
            answer_end=self.answer_end,
            repeatable=self.repeatable,
            deadlines=self.deadlines,
            when_odd=self.when_odd,
        )

    def identify(self) -> Identity:
        """Ask `*IDN?`; the answer is maker, model, serial number, firmware."""
        return Identity(*identification(self.place.name, self._line.query("*IDN?"))[:4])

    def take_errors(self) -> list[str]:
        """Return the errors that it keeps, the oldest first, and leave its queue empty."""
        return errors_until_none(self.place.name, self._line.next_error)


def errors_until_none(name: str, next_error: Callable[[], str]) -> list[str]:
    """Return the errors of a queue, the oldest first; `next_error` takes one, empty for none.

    Raises InstrumentError where there is no end of them.
    """
    kept = list(islice(iter(next_error, ""), MAX_KEPT_ERRORS))
    if len(kept) == MAX_KEPT_ERRORS:
        raise InstrumentError(
            name,
            "emptied its error queue",
            f"it still reports {shortened(kept[-1])} after {MAX_KEPT_ERRORS} errors",
            "read the instrument's display, then switch it off and on",
        )
    return kept


def number_of(instrument: str, message: str, answer: str) -> float:
    """Return the answer to a message as a finite number; anything else is InstrumentError."""
    (value,) = numbers_of(instrument, message, [answer], "a number belongs")
    return value


def numbers_of(
    instrument: str, message: str, parts: list[str], expected: str = "numbers belong"
) -> list[float]:
    """Return the parts of an answer as finite numbers; anything else is InstrumentError."""
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise InstrumentError(
            instrument,
            f"sent {message!r}",
            f"{shortened(','.join(parts))!r} came back where {expected}",
            "check the cable and that nobody else talks to the instrument",
        )
    return values


def check_written(
    instrument: str, what: str, value: float, read_back: float, agrees: float
) -> None:
    """Raise InstrumentError where another value reads back than was written."""
    if abs(read_back - value) > agrees:
        raise InstrumentError(
            instrument,
            f"set {what} to {value:g}",
            f"{read_back:g} reads back",
            "check that nobody else talks to the controller, then run again",
        )


def odd(
    instrument: str, attempted: str, answer: str, do_now: str = OTHER_ADDRESS
) -> InstrumentError:
    """Return the error of an answer that is none."""
    return InstrumentError(instrument, attempted, f"{shortened(answer)!r} came back", do_now)


IDENTITY = re.compile(r"(?is)[^,]*[a-z][^,]*,[^,]+,[^,]*,[^,]+|.*\bversion\b.*")
"""Of whatever model: fields as `*IDN?` has them, or a text with its version."""


def not_this_model(
    instrument: str, attempted: str, answer: str, do_now: str = OTHER_ADDRESS
) -> InstrumentError:
    """Return the error of what came for an identity; AnotherInstrument where it is another's."""
    kind = AnotherInstrument if IDENTITY.fullmatch(answer.strip()) else InstrumentError
    return kind(instrument, attempted, f"{shortened(answer)!r} came back", do_now)


def identification(instrument: str, answer: str) -> list[str]:
    """Return the fields of an answer to `*IDN?`, four at least; fewer are an InstrumentError."""
    fields = [field.strip() for field in answer.split(",")]
    if len(fields) < 4:
        raise odd(instrument, "asked *IDN?", answer)
    return fields
