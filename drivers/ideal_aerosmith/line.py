"""The line of an Ideal Aerosmith table: a prompt behind every answer, and `?` for a refusal."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from drivers.transport.exchanges import ExchangeLine, Repeatable, shortened
from drivers.transport.ports import Port, SerialSettings, serial_port
from drivers.transport.text_line import ENCODING, TextLine, number_of, odd
from station.errors import InstrumentError
from station.roles import Place

IDENTITY_QUESTION = "IDN?"
"""No document has a question of who is there. What a table answers to one that it does not know is
no number, as all that it measures is: so this shows whether the line is in step."""

PROMPT = ">"
POSITION = "PPO"
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
REFUSAL = re.compile(r"(?i)\?|\b(?:err|error|invalid|unknown)\b")
SENT_DECIMALS = 6
COMPARE = "compare the plan's and the bench file's values with the table's ranges"
NOBODY_ELSE = "check the cable and that nobody else talks to the table"


class RefusedByTable(InstrumentError):
    """A command that the table answered with a refusal, and what it said."""

    def __init__(self, instrument: str, message: str, said: str) -> None:
        self.said = f"it refused ({shortened(said)})"
        super().__init__(instrument, f"sent {shortened(message)!r}", self.said, COMPARE)


class AtlLine(TextLine):
    """Messages to one controller; `prefixes` are the words before a command, axis by axis.

    A command that was carried out is answered by the prompt alone, and some are not answered at
    all: each asks for the position in the same exchange, whose answer shows that it was heard.
    """

    padding = b"\r\n >"  # a prompt that came late holds no value

    def __init__(
        self,
        place: Place,
        settings: SerialSettings,
        prefixes: Sequence[str],
        met: Callable[[str], None],
        repeatable: Repeatable,
    ) -> None:
        self._prefixes, self._met = prefixes, met
        super().__init__(
            place,
            serial_port(place.address, settings),
            request_end="\r",
            answer_end=PROMPT,
            ignores_empty=True,
            repeatable=repeatable,
            identity=IDENTITY_QUESTION,
            when_odd=NOBODY_ELSE,
        )

    def of_axis(self, axis: int, command: str) -> str:
        """Return a command as it is sent for an axis."""
        return f"{self._prefixes[axis - 1]}{command}"

    def value(self, axis: int, question: str) -> float:
        """Return a number that an axis answers; InstrumentError for a refusal or anything else."""
        return self.number(self.of_axis(axis, question))

    def value_if_known(self, axis: int, question: str) -> float | None:
        """Return a number that an axis answers; None where its firmware refuses the question."""
        message = self.of_axis(axis, question)
        return self.patiently(message, lambda: self._value_if_known(message))

    def _value_if_known(self, message: str) -> float | None:
        answer = self.query(message)
        if REFUSAL.search(answer):
            return None
        return number_of(self._place.name, message, answer)

    def command(self, axis: int, command: str) -> None:
        """Send a command; RefusedByTable, an InstrumentError, where the table refuses it."""
        message = self.of_axis(axis, command)
        self.patiently(message, lambda: self._carried_out(message, axis))

    def _carried_out(self, message: str, axis: int) -> None:
        refusal = self._exchange(message, lambda port: self._told(port, message, axis))
        if refusal:
            raise RefusedByTable(self._place.name, message, refusal)

    def _told(self, port: Port, message: str, axis: int) -> str:
        """Send a command and ask for the position; return what was said against it, if anything."""
        attempted, asked = f"sent {shortened(message)!r}", self.of_axis(axis, POSITION)
        self._write(port, f"{message}\r{asked}")

        def answered(came: bytes) -> bool:
            said = [text for text in answers(came, message, asked) if text]
            return bool(said) and (len(said) > 1 or NUMBER.fullmatch(said[-1]) is not None)

        came = self._came(port, attempted, self.deadline_of_s(asked), answered)
        *before, position = answers(came, message, asked)
        said = " ".join(text for text in before if text)
        if NUMBER.fullmatch(position) is None and not REFUSAL.search(said):
            raise odd(self._place.name, attempted, f"{said} {position}".strip(), NOBODY_ELSE)
        if not before:
            self._met(f"answers {message.removeprefix(self._prefixes[axis - 1])[:3]} by nothing")
        return said

    def _read(self, port: Port, message: str, deadline_s: float) -> str:
        """Return the one value of an answer, without prompt and echo; AnswerInDoubt for more."""
        attempted = f"sent {shortened(message)!r}"
        came = self._came(port, attempted, deadline_s, lambda came: any(answers(came, message)))
        said = [line for text in answers(came, message) for line in text.splitlines()]
        if message == IDENTITY_QUESTION:
            return " ".join(said)
        if len(said) > 1:
            self._doubt(came, attempted)
            text = shortened(came.decode(ENCODING))
            raise self._doubtful(attempted, f"{text!r} came back, more than one answer")
        return said[0]

    def _came(
        self, port: Port, attempted: str, deadline_s: float, is_whole: Callable[[bytes], bool]
    ) -> bytes:
        """Return what came, whole and in ASCII."""
        came = self._receive(port, attempted, deadline_s, is_whole)
        text = shortened(came.decode(ENCODING, "backslashreplace"))
        if not came.isascii():
            raise self._wrong(attempted, f"{text!r} came back, which is no text")
        if not is_whole(came):
            raise self._silent(
                attempted, f"only {text!r} came, without the end of an answer,", deadline_s
            )
        return came

    def _names(self, answer: str) -> bool:
        return bool(answer) and NUMBER.fullmatch(answer) is None

    def _settle(self, port: Port, message: str, answer: object) -> None:
        """Have what is measured asked anew by whoever needs it; what else is repeatable is done."""
        ExchangeLine._settle(self, port, message, answer)


def answers(came: bytes, *sent: str) -> list[str]:
    """Return the text before each prompt that came, without the echo of what was sent."""
    *parts, _ = came.decode(ENCODING, "backslashreplace").split(PROMPT)
    return [without_echo(part, sent) for part in parts]


def without_echo(text: str, sent: Sequence[str]) -> str:
    """Return what a table says beside the message, which some say again before the answer."""
    lines = [line.strip() for line in re.split(r"[\r\n]+", text)]
    for message in sent:
        lines = [line.removeprefix(message).strip() for line in lines]
    return "\n".join(line for line in lines if line)


def number(value: float) -> str:
    """Return a number as the clients write it: whole where it is, else with decimals."""
    return f"{round(value, SENT_DECIMALS) + 0.0:.{SENT_DECIMALS}f}".rstrip("0").rstrip(".")
