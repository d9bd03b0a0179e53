"""The language of an ACUTROL3000 (ACL): headers, abbreviations, and several commands a message.

From the command language manual TM-8004-C: `:Main:Sub arguments`, upper and lower case alike, any
unambiguous abbreviation; the first colon may be left out; after `;` the next command stays in the
subsystem, after `;:` it starts from the root; a comma between header and arguments is an error.
The numbers of the errors are not in the sources at hand: these are assumed, their words partly.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple

UNKNOWN_COMMAND = 1
AMBIGUOUS = 2
SYNTAX = 3
MISSING_PARAMETER = 4
OUT_OF_RANGE = 5
NOT_SERVOED = 6
INTERLOCK_OPEN = 7
STATUS_FROZEN = 8
TOO_LONG = 9
TEXTS = {
    0: "NO ERROR",
    UNKNOWN_COMMAND: "UNKNOWN COMMAND",
    AMBIGUOUS: "AMBIGUOUS ABBREVIATION",
    SYNTAX: "SYNTAX ERROR",
    MISSING_PARAMETER: "MISSING PARAMETER",
    OUT_OF_RANGE: "PARAMETER OUT OF RANGE",
    NOT_SERVOED: "AXIS NOT SERVOED",
    INTERLOCK_OPEN: "INTERLOCK OPEN",
    STATUS_FROZEN: "INTERLOCK RESET REQUIRED",
    TOO_LONG: "MESSAGE TOO LONG",
}
KEPT_MESSAGES = 256
COMMAND = re.compile(r"([A-Za-z:]+)(\?)?(?:\s+(.*))?", re.DOTALL)
COMMON = re.compile(r"(\*[A-Za-z]+)(\?)?(?:\s+(.*))?", re.DOTALL)

LETTERS = {
    (): {"D": "DEMAND", "I": "INTERLOCK", "L": "LIMIT", "M": "MODE", "R": "READ", "U": "UTILITY"},
    ("DEMAND",): {
        "P": "POSITION",
        "R": "RATE",
        "A": "ACCELERATION",
        "D": "DELTAPOSITION",
        "O": "OSCILLATOR",
    },
    ("INTERLOCK",): {"C": "CLOSE", "O": "OPEN", "R": "RESET"},
    ("LIMIT",): {
        "A": "ACCELERATION",
        "R": "RATE",
        "H": "HIGHPOSITION",
        "L": "LOWPOSITION",
        "V": "VTRIP",
    },
    ("MODE",): {"P": "POSITION"},
    ("READ",): {"V": "SVECTOR"},
    ("UTILITY",): {"L": "LOCKOUT"},
}
"""The forms of one letter of the controller before (Act2000), which win over ambiguity."""

Answer = str | float | list[float] | tuple[str | float, ...]
"""A text, a number, several that `,` parts, or several that `;` parts."""

Act = Callable[[list[str]], Answer | None]


class AclError(Exception):
    """A refusal by the controller, with its number."""

    def __init__(self, code: int) -> None:
        super().__init__(TEXTS[code])
        self.code = code


class Step(NamedTuple):
    """One command of a message: what it does, or the error that it is."""

    act: Act | None
    arguments: list[str]
    code: int = 0


class Language:
    """A table of headers such as `Demand:Rate?` and `*IDN?`; a final `?` makes one a query."""

    def __init__(self, table: Mapping[str, Act]) -> None:
        self._acts: dict[tuple[str, ...], Act] = {}
        for header, act in table.items():
            asks = ("?",) if header.endswith("?") else ()
            self._acts[(*header.removesuffix("?").upper().split(":"), *asks)] = act
        self._known: dict[str, list[Step]] = {}

    def steps(self, message: str) -> list[Step]:
        """Return the commands of a message; the same message is taken apart once."""
        if message not in self._known:
            if len(self._known) >= KEPT_MESSAGES:
                self._known.clear()
            self._known[message] = self._taken_apart(message)
        return self._known[message]

    def _taken_apart(self, message: str) -> list[Step]:
        steps: list[Step] = []
        subsystem: tuple[str, ...] = ()
        for text in message.split(";"):
            command = text.strip()
            if not command:
                continue
            try:
                step, subsystem = self._step(command, subsystem)
            except AclError as error:
                step = Step(None, [], error.code)
            steps.append(step)
        return steps

    def _step(self, command: str, subsystem: tuple[str, ...]) -> tuple[Step, tuple[str, ...]]:
        common = COMMON.fullmatch(command)
        if common is not None:
            path: tuple[str, ...] = (common[1].upper(),)
            return self._resolved(path, common[2], common[3]), subsystem
        match = COMMAND.fullmatch(command)
        if match is None:
            raise AclError(SYNTAX)
        header = match[1]
        words = [word.upper() for word in header.removeprefix(":").split(":")]
        path = () if header.startswith(":") else subsystem
        for word in words:
            path = (*path, self._whole(path, word))
        return self._resolved(path, match[2], match[3]), path[:-1]

    def _resolved(self, path: tuple[str, ...], asks: str | None, rest: str | None) -> Step:
        act = self._acts.get((*path, "?") if asks else path)
        if act is None:
            raise AclError(UNKNOWN_COMMAND)
        text = (rest or "").strip()
        return Step(act, [part.strip() for part in text.split(",")] if text else [])

    def _whole(self, path: tuple[str, ...], word: str) -> str:
        if letter := LETTERS.get(path, {}).get(word):
            return letter
        depth = len(path)
        words = {
            known[depth] for known in self._acts if known[:depth] == path and len(known) > depth
        }
        return whole(word, words - {"?"}, UNKNOWN_COMMAND)


def whole(text: str, words: Iterable[str], otherwise: int = OUT_OF_RANGE) -> str:
    """Return the word, in capitals, that `text` is or abbreviates; AclError where there is none."""
    short = text.upper()
    known = {word.upper() for word in words}
    if short in known:
        return short
    matching = [word for word in known if short and word.startswith(short)]
    if not matching:
        raise AclError(otherwise)
    if len(matching) > 1:
        raise AclError(AMBIGUOUS)
    return matching[0]


def argument(arguments: list[str], place: int) -> str:
    """Return one argument; AclError where it is missing."""
    if place >= len(arguments) or not arguments[place]:
        raise AclError(MISSING_PARAMETER)
    return arguments[place]


NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")


def number(arguments: list[str], place: int) -> float:
    """Return an argument as a number, which is written without an exponent."""
    return number_of(argument(arguments, place))


@lru_cache(KEPT_MESSAGES)
def number_of(text: str) -> float:
    """Return a text as a number; AclError where it is none."""
    if NUMBER.fullmatch(text) is None:
        raise AclError(SYNTAX)
    return float(text)


def decimal(value: float, decimals: int) -> str:
    """Return a number as the controller writes it: no exponent, no leading plus, no minus zero."""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def rounded(text: str, decimals: int) -> str:
    """Return an argument as the controller takes it: a number to so many decimals."""
    if "." not in text or NUMBER.fullmatch(text) is None:
        return text
    return f"{float(text):.{decimals}f}"
