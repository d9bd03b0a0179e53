"""Say again what may be said twice, where one lost answer must not decide; the rest once.

A driver declares which of its messages do no harm when the instrument gets them twice: its
`repeatable`. On the way to rest, where a lost answer must not end in a coil that is cut off at full
current, and by whoever watches a level, such a message is said again whatever went wrong with it.
In a step it is said again only where its line broke, or where its answer was not the only one that
came (`ExchangePort`). Any other fault, and each one of any other message, ends the run at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, TypeVar

from station.errors import InstrumentError

Answer = TypeVar("Answer")

TRIES = 3


class Repeatable:
    """The messages of an instrument that may be said twice.

    Each pattern is a regular expression for one whole command, upper and lower case alike, without
    the colon before it. A message of several commands, joined by `;`, is repeatable when each of
    them is and starts from the root again (`:` or `*`): what a relative header means depends on
    the one before it. An instrument without such headers has `rooted` False.
    """

    def __init__(self, *patterns: str, rooted: bool = True) -> None:
        self._rooted = rooted
        self._pattern = re.compile("|".join(f"(?:{one})" for one in patterns), re.IGNORECASE)
        self._known: dict[str, bool] = {}

    def __contains__(self, message: object) -> bool:
        text = str(message)
        if text not in self._known:
            # Queries come again and again; set-points, of which there is no end, are not kept.
            found = self._all_match(text)
            if not text.endswith("?"):
                return found
            self._known[text] = found
        return self._known[text]

    def _all_match(self, message: str) -> bool:
        first, *others = message.split(";")
        rooted = not self._rooted or all(one.lstrip().startswith((":", "*")) for one in others)
        commands = [one.strip().removeprefix(":") for one in (first, *others)]
        return rooted and all(self._pattern.fullmatch(one) for one in commands)


NEVER = Repeatable(r"(?!)")
"""Nothing may be said twice."""


def repeated(repeatable: Repeatable, message: str, exchange: Callable[[], Answer]) -> Answer:
    """Return what an exchange of `message` brings, tried three times before its error is believed.

    One that is not repeatable is tried once.
    """
    for _ in range(TRIES - 1 if message in repeatable else 0):
        with suppress(InstrumentError):
            return exchange()
    return exchange()


class Line(Protocol):
    """A line of text with an error queue at its other end."""

    def query(self, message: str) -> str:
        """Send a message and return the answer."""
        ...

    def command(self, message: str) -> None:
        """Send a command and read the error queue."""
        ...

    def number(self, message: str) -> float:
        """Return the answer as a finite number."""
        ...


class PatientLine:
    """A line on which everything repeatable is tried three times before its error is believed."""

    def __init__(self, line: Line, repeatable: Repeatable) -> None:
        self._line = line
        self._repeatable = repeatable

    def query(self, message: str) -> str:
        """Send `message` and return the answer without its end."""
        return repeated(self._repeatable, message, lambda: self._line.query(message))

    def command(self, message: str) -> None:
        """Send a command and read the error queue in one exchange; a refusal is InstrumentError."""
        repeated(self._repeatable, message, lambda: self._line.command(message))

    def number(self, message: str) -> float:
        """Return the answer to `message` as a finite number; anything else is InstrumentError."""
        return repeated(self._repeatable, message, lambda: self._line.number(message))
