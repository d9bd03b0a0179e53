"""The grammar and the error queue that instruments speaking SCPI share (SCPI-99 volume 1, 6)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import cache, partial
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

Handler = Callable[[list[str]], str | None]

TEXTS = {
    -100: "Command error",
    -102: "Syntax error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -120: "Numeric data error",
    -151: "Invalid string data",
    -161: "Invalid block data",
    -203: "Command protected",
    -211: "Trigger ignored",
    -213: "Init ignored",
    -214: "Trigger deadlock",
    -221: "Settings conflict",
    -222: "Data out of range",
    -223: "Too much data",
    -224: "Illegal parameter value",
    -226: "Lists not same length",
    -230: "Data stale",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
    -400: "Query error",
}


SWITCH = {"ON": "ON", "1": "ON", "OFF": "OFF", "0": "OFF"}
NO_ERROR = '0,"No error"'


class ScpiError(Exception):
    """A refusal by the instrument, with its number in the error queue."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Unit(NamedTuple):
    """One command of a message: the full header, whether it asks, and its parameters."""

    path: tuple[str, ...]
    query: bool
    parameters: list[str]


class Header(NamedTuple):
    """All paths of short names that a header may be written as, and the short form of each name."""

    paths: tuple[tuple[str, ...], ...]
    query: bool
    short: dict[str, str]


def short_of(name: str) -> str:
    """Return the short form of a name such as `CURRent`."""
    return "".join(letter for letter in name if not letter.islower())


@cache
def parsed(pattern: str) -> Header:
    """Return what a pattern such as `LIST:CURRent[:LEVel]?` stands for."""
    text = pattern.removesuffix("?").replace("[:", "\0[").replace(":", "\0").replace("]", "")
    shorts: dict[str, str] = {}
    choices: list[list[tuple[str, ...]]] = []
    for node in filter(None, text.split("\0")):
        name = node.lstrip("[")
        short = short_of(name)
        shorts |= {name.upper(): short, short: short}
        choices.append([(short,), ()] if node.startswith("[") else [(short,)])
    paths = tuple(tuple(name for part in pick for name in part) for pick in product(*choices))
    return Header(paths, pattern.endswith("?"), shorts)


class CommandTree:
    """Headers such as `LIST:CURRent[:LEVel]` with what they do; short and long forms, any case."""

    def __init__(self) -> None:
        self._handlers: dict[tuple[tuple[str, ...], bool], Handler] = {}
        self._short: dict[str, str] = {}

    def add(self, pattern: str, handler: Handler) -> None:
        """Add a header; a final `?` makes it a query, `[:NODE]` may be left out."""
        header = parsed(pattern)
        self._short.update(header.short)
        for path in header.paths:
            self._handlers[path, header.query] = handler

    def find(self, unit: Unit) -> Handler:
        """Return what a command does; ScpiError -113 when nothing has this header."""
        handler = self._handlers.get((unit.path, unit.query))
        if handler is None:
            raise ScpiError(-113)
        return handler

    def parse(self, message: str) -> list[Unit]:
        """Split a message at `;`; each header continues where the one before it stood.

        A leading colon goes back to the root, and common commands (`*IDN?`) leave the place alone.
        """
        units = []
        place: tuple[str, ...] = ()
        for text in split_outside_quotes(message, ";"):
            header, _, rest = text.strip().partition(" ")
            if not header:
                continue
            query = header.endswith("?")
            name = header.removesuffix("?").upper()
            parameters = [part.strip() for part in split_outside_quotes(rest, ",")]
            if parameters == [""]:
                parameters = []
            if name.startswith("*"):
                units.append(Unit((name,), query, parameters))
                continue
            start = () if name.startswith(":") else place
            nodes = tuple(self._short.get(node, "?") for node in name.lstrip(":").split(":"))
            units.append(Unit(start + nodes, query, parameters))
            place = (start + nodes)[:-1]
        return units


def split_outside_quotes(text: str, separator: str) -> list[str]:
    """Split a text at a separator, but not inside quotes."""
    if '"' not in text and "'" not in text:
        return text.split(separator)
    parts, quote = [""], ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter == separator:
            parts.append("")
            continue
        parts[-1] += letter
    return parts


class ErrorQueue:
    """First in, first out; when full the last entry becomes `overflow`, or the newest with 0."""

    overflow = -350

    def __init__(
        self, depth: int, empty: str = NO_ERROR, own_texts: Mapping[int, str] = MappingProxyType({})
    ) -> None:
        self._entries: deque[str] = deque()
        self._depth, self._empty, self._texts = depth, empty, {**TEXTS, **own_texts}

    def __len__(self) -> int:
        return len(self._entries)

    def entry(self, text: str, code: int) -> str:
        """Return an error as it is answered."""
        return f'{code:+d},"{text}"'

    def push(self, code: int, more: str = "") -> None:
        """Append an error; `more` follows its standard text."""
        if len(self._entries) == self._depth:
            self._entries.pop()
            code, more = (self.overflow, "") if self.overflow else (code, more)
        text = self._texts[code]
        self._entries.append(self.entry(f"{text};{more}" if more else text, code))

    def pop(self) -> str:
        """Return and remove the oldest error, or what an empty queue answers."""
        return self._entries.popleft() if self._entries else self._empty

    def pop_all(self) -> str:
        """Return and remove all errors, comma-separated."""
        entries = ",".join(self._entries)
        self.clear()
        return entries or NO_ERROR

    def clear(self) -> None:
        """Forget all errors."""
        self._entries.clear()


def number(text: str) -> float:
    """Return a numeric parameter; ScpiError -120 when it is none."""
    try:
        value = float(text)
    except ValueError:
        raise ScpiError(-120) from None
    if value != value or value in (float("inf"), float("-inf")):
        raise ScpiError(-120)
    return value


def whole_number(text: str, minimum: int, maximum: int) -> int:
    """Return a whole number within limits (NRf is rounded); ScpiError -120 or -222 otherwise."""
    value = round(number(text))
    if not minimum <= value <= maximum:
        raise ScpiError(-222)
    return value


def number_or(text: str, words: Mapping[str, float]) -> float:
    """Return a number, or what a word stands for."""
    word = text.upper()
    return words[word] if word in words else number(text)


def numeric(text: str, lowest: float, highest: float, default: float) -> float:
    """Return a number or what MIN, MAX, DEF stand for; ScpiError -222 beyond the limits."""
    words = {"MIN": lowest, "MAX": highest, "DEF": default, "MINIMUM": lowest, "MAXIMUM": highest}
    value = number_or(text, words)
    if not lowest <= value <= highest:
        raise ScpiError(-222)
    return value


def within(lowest: float, highest: float, default: float) -> Callable[[str], float]:
    """Return what reads a number between two, see `numeric`."""
    return lambda text: numeric(text, lowest, highest, default)


def choice(text: str, names: Mapping[str, str]) -> str:
    """Return what a word stands for, `names` holding short and long forms; ScpiError -224."""
    word = text.upper()
    if word not in names:
        raise ScpiError(-224)
    return names[word]


@cache
def words(*names: str) -> Mapping[str, str]:
    """Return the short form of each name, such as `POSitive`, by its short and its long form."""
    return {form: short_of(name) for name in names for form in (short_of(name), name.upper())}


def word(*names: str) -> Callable[[str], str]:
    """Return what reads the short form of a name, such as `POSitive`, in either form."""
    return partial(choice, names=words(*names))


def boolean(text: str) -> bool:
    """Return ON, OFF, 1 or 0 as a truth value; ScpiError -224 for anything else."""
    return choice(text, SWITCH) == "ON"


def single_parameter(parameters: list[str]) -> str:
    """Return the only parameter; ScpiError -109 without one, -108 with more."""
    if not parameters:
        raise ScpiError(-109)
    if len(parameters) > 1:
        raise ScpiError(-108)
    return parameters[0]


def none(parameters: list[str]) -> None:
    """Check that there is no parameter; ScpiError -108 otherwise."""
    if parameters:
        raise ScpiError(-108)


def unquoted(text: str) -> str:
    """Return what stands between quotes; ScpiError -151 without them."""
    if len(text) < 2 or text[0] not in "\"'" or text[-1] != text[0]:
        raise ScpiError(-151)
    return text[1:-1]
