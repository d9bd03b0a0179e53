"""Repeat a message that does no harm twice, where one lost answer must not decide.

A driver declares which of its messages do no harm when the instrument gets them twice: its
`repeatable`. On the way to rest, where a lost answer must not end in a coil that is cut off at full
current, and by whoever watches a level, such a message is sent again whatever went wrong with it.
In a step it is sent again only where its line broke, or where its answer was not the only one that
came (`ExchangePort`). Any other fault, and each one of any other message, ends the run at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from typing import Any, Protocol, TypeVar

from station.errors import InstrumentError
from station.roles import TRIES, Place
from station.roles.patience import PATIENT, patience

Answer = TypeVar("Answer")

MESSAGES_KEPT = 256
"""Queries come again and again; of set-points there is no end."""


class Repeatable:
    """The messages of an instrument that may be sent twice.

    Each pattern is a regular expression for one whole command, upper and lower case alike, without
    the colon before it. A message of several commands, joined by `;`, is repeatable when each of
    them is and starts from the root again (`:` or `*`): what a relative header means depends on
    the one before it. An instrument without such headers has `rooted` False.
    """

    def __init__(self, *patterns: str, rooted: bool = True) -> None:
        self._rooted = rooted
        self._pattern = re.compile(
            "|".join(f"(?:{pattern})" for pattern in patterns), re.IGNORECASE
        )
        self._known = lru_cache(MESSAGES_KEPT)(self._all_match)

    def __contains__(self, message: object) -> bool:
        return self._known(str(message))

    def _all_match(self, message: str) -> bool:
        first, *others = message.split(";")
        rooted = not self._rooted or all(other.lstrip().startswith((":", "*")) for other in others)
        commands = [command.strip().removeprefix(":") for command in (first, *others)]
        return rooted and all(self._pattern.fullmatch(command) for command in commands)


NEVER = Repeatable(r"(?!)")
"""Nothing may be sent twice."""


def patiently(repeatable: Repeatable, message: str, exchange: Callable[[], Answer]) -> Answer:
    """Return what an exchange of `message` brings.

    Where one lost answer must not decide (`patience`) and the message is repeatable, the exchange
    is tried three times, as a whole, before its error is believed.
    """
    if PATIENT.get() and message in repeatable:
        with patience(granted=False):
            for _ in range(TRIES - 1):
                with suppress(InstrumentError):
                    return exchange()
            return exchange()
    return exchange()


class ProvableLine(Protocol):
    """A line that can tell whether it is in step."""

    doubts: int
    """How often something was found that nobody had asked for."""
    delays: int
    """How often the line was opened anew or read until quiet, which takes time."""

    def echoes_identity(self) -> bool:
        """Whether the answer to who is there is the identity."""
        ...

    def resynchronise(self) -> None:
        """Have the next exchange begin on a line that is opened anew and quiet."""
        ...


class Proof:
    """The proof that one line's answers are those to the questions asked.

    A line may be out of step: a stray line, a lost or doubled answer, a device that is some
    answers behind. Then each answer looks like one, and belongs to another question. Where a
    reading decides whether something is at rest, an identity is asked before, between and after
    the readings: no other question has that answer, so none of them can have moved.
    """

    def __init__(self, place: Place, line: ProvableLine) -> None:
        self._place, self._line = place, line

    def in_step(self) -> bool:
        """Whether the line answers who is there with the identity, at once; never raises."""
        delays = self._line.delays
        with suppress(InstrumentError):
            return self._line.echoes_identity() and self._line.delays == delays
        return False

    def of(self, *readings: Callable[[], Any]) -> list[Any]:
        """Return what the readings bring, with two identities before and one after each of them.

        All are asked again, three times at most, where one of the identities is none or something
        came that was not asked for. Raises InstrumentError where that brings no proof.
        """
        failed: InstrumentError | None = None
        for _ in range(TRIES):
            results, doubts, failed = [], self._line.doubts, None
            try:
                # Twice, so that a line two answers behind meets an identity where a reading is due.
                in_step = self._line.echoes_identity() and self._line.echoes_identity()
                for read in readings if in_step else ():
                    results.append(read())
                    in_step = in_step and self._line.echoes_identity()
            except InstrumentError as error:
                in_step, failed = False, error
            if in_step and self._line.doubts == doubts:
                return results
            with suppress(InstrumentError):
                self._line.resynchronise()
        if failed is not None:
            raise failed
        raise InstrumentError(
            self._place.name,
            "asked who it is between readings, to prove that each is the answer to its question",
            "it answered with something else each time, so nothing that it reads back counts",
            "look at its display, switch it off by hand where it is on, then switch it off and on",
        )
