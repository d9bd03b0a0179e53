"""What every line does alike: it traces bytes and faults, and reads answers as numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from itertools import islice

from drivers.transport.not_opened import why_not_opened
from station.errors import AnotherInstrument, InstrumentError, InstrumentTimeout
from station.roles import Place


class AnswerInDoubt(InstrumentError):
    """An answer that may belong to another question, or to none."""


class LineBroken(InstrumentError):
    """A connection that ended while it was used."""


class TooLate(InstrumentError):
    """A message that was not sent: its line had to be brought into step, and its moment is over."""


class TracedLine:
    """What every line does alike."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._clock = place.clock
        self._trace = place.trace

    def _traced(self, direction: str, data: bytes) -> None:
        if self._trace is not None:
            self._trace(direction, data)

    def _fault(
        self,
        attempted: str,
        came_back: str,
        do_now: str,
        kind: type[InstrumentError] = InstrumentError,
    ) -> InstrumentError:
        self._traced("!", f"{attempted}: {came_back}".encode())
        return kind(self._place.name, attempted, came_back, do_now)

    def _not_opened(self, error: BaseException) -> InstrumentError:
        """Return the error of a line that cannot be opened, with what to do about its cause."""
        why_not = " ".join(str(error).split())
        known = why_not_opened(self._place.address, error)
        if known is None:
            return self._nobody_answers(why_not)
        why, do_now = known
        return self._fault(f"open {self._place.address}", f"{why} ({why_not})", do_now)

    def _nobody_answers(
        self, why: object, do_now: str = "switch the instrument on, check its cable"
    ) -> InstrumentError:
        return self._fault(
            f"open {self._place.address}",
            f"nothing answers there ({why})",
            f"{do_now} and the address in the bench file",
        )


OTHER_ADDRESS = "check that the address in the bench file is its own"


MAX_KEPT_ERRORS = 100
"""More than any of these instruments keeps."""


class ExchangeLine(TracedLine):
    """What may go wrong with a question and its answer, and what to do about it."""

    when_silent = "check that the instrument is on, and its cable"
    when_wrong = "check the cable, and that nobody else talks to the instrument"

    def _silent(self, attempted: str, what: str, deadline_s: float) -> InstrumentError:
        came_back = f"{what} within {deadline_s:g} s"
        do_now = f"{self.when_silent}; one that takes longer needs a `deadline` in the bench file"
        return self._fault(attempted, came_back, do_now, InstrumentTimeout)

    def _wrong(self, attempted: str, came_back: str) -> InstrumentError:
        return self._fault(attempted, came_back, self.when_wrong)

    def _doubtful(self, attempted: str, came_back: str) -> InstrumentError:
        return self._fault(attempted, came_back, self.when_wrong, AnswerInDoubt)

    def _too_late(self, message: str) -> InstrumentError:
        return self._fault(
            f"send {shortened(message)!r} at its moment",
            "something lay on the line, and the moment is over now that it is empty",
            self.when_wrong,
            TooLate,
        )


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


def shortened(text: str, longest: int = 60) -> str:
    """Return `text`, its middle left out when it is long."""
    return text if len(text) <= longest else f"{text[: longest // 2]}…{text[-longest // 2 :]}"
