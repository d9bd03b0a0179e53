"""What a Lake Shore 336 keeps: curves, alarms, relays, zones, monitor outputs, panel, network.

By the maker's public client (order and number of the fields, what of them is a word) and QCoDeS;
where these say nothing, the ranges are those of the manuals of the family as generally known:
curves 1 to 20 are the maker's and not to be changed, 21 to 59 the user's with 200 points each, a
text of fifteen characters is answered with blanks behind it. A field left empty stays as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

EXECUTION_ERROR = 16
CURVES, USER_CURVES, POINTS = range(1, 60), range(21, 60), range(1, 201)
PT100 = 6
LOG_OHM = 4
ZERO_DEGC_K = 273.15
NAME, SERIAL = 15, 10


class RefusedCommand(Exception):
    """A command that the controller does not carry out, with the bit of `*ESR?` that says so."""


Field = Callable[[str], str]
"""Returns a field as it is answered; RefusedCommand for a value that it cannot have."""


class Kept(NamedTuple):
    """A setting: what it is asked by, its fields, and their values at first."""

    keys: tuple[Sequence[str], ...]
    fields: tuple[Field, ...]
    at_first: str


def whole(low: int, high: int, width: int = 1) -> Field:
    """Return a field of whole numbers."""

    def read(text: str) -> str:
        value = float_of(text)
        if value != int(value) or not low <= value <= high:
            raise RefusedCommand(EXECUTION_ERROR)
        return f"{int(value):0{width}d}"

    return read


def real(low: float, high: float, form: str = "+.3f") -> Field:
    """Return a field of numbers."""

    def read(text: str) -> str:
        value = float_of(text)
        if not low <= value <= high:
            raise RefusedCommand(EXECUTION_ERROR)
        return f"{value:{form}}"

    return read


def words(longest: int, *, padded: bool = True) -> Field:
    """Return a field of text."""

    def read(text: str) -> str:
        if len(text) > longest and text[longest:].strip():
            raise RefusedCommand(EXECUTION_ERROR)
        return text[:longest].ljust(longest) if padded else text

    return read


def address(text: str) -> str:
    """Return a field that is an address of a network."""
    parts = text.strip().split(".")
    if len(parts) != 4 or not all(part.isdecimal() and int(part) < 256 for part in parts):
        raise RefusedCommand(EXECUTION_ERROR)
    return ".".join(str(int(part)) for part in parts)


def float_of(text: str) -> float:
    """Return a number; RefusedCommand for none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RefusedCommand(EXECUTION_ERROR)
    return value


ON = whole(0, 1)
KELVIN = real(-ZERO_DEGC_K, 9999.0)
PERCENT = real(0.0, 100.0, "+07.2f")
SIGNED_PERCENT = real(-100.0, 100.0, "+07.2f")
INPUT = whole(0, 4)
ADDRESSES = (address,) * 5
ZONE = (
    real(0.0, 9999.0),
    real(0.0, 1000.0, "+07.1f"),
    real(0.0, 1000.0, "+07.1f"),
    real(0.0, 200.0, "+06.1f"),
    PERCENT,
    whole(0, 3),
    INPUT,
    real(0.0, 100.0, "+06.1f"),
)
SETTINGS: Mapping[str, Kept] = {
    "INNAME": Kept(("ABCD",), (words(NAME),), "Input"),
    "ALARM": Kept(
        ("ABCD",),
        (ON, KELVIN, KELVIN, real(0.0, 9999.0), ON, ON, ON),
        "0,1000,0,0,0,1,1",
    ),
    "DIOCUR": Kept(("ABCD",), (ON,), "0"),
    "INCRV": Kept(("ABCD",), (whole(0, CURVES[-1], 2),), str(PT100)),
    "RELAY": Kept(("12",), (whole(0, 2), lambda text: channel(text), whole(0, 2)), "0,A,0"),
    "ZONE": Kept(("12", [str(k) for k in range(1, 11)]), ZONE, "0,50,20,0,0,0,0,0.1"),
    "ANALOG": Kept(("34",), (INPUT, whole(1, 3), KELVIN, KELVIN, ON), "0,1,1000,0,0"),
    "WARMUP": Kept(("34",), (ON, PERCENT), "1,100"),
    "DISPLAY": Kept((), (whole(0, 8), whole(0, 2), whole(1, 4)), "4,1,1"),
    "DISPFLD": Kept(("12345678",), (INPUT, whole(1, 6)), "1,1"),
    "BRIGT": Kept((), (whole(1, 32, 2),), "28"),
    "LEDS": Kept((), (ON,), "1"),
    "LOCK": Kept((), (ON, whole(0, 999, 3)), "0,123"),
    "MODE": Kept((), (whole(0, 2),), "0"),
    "IEEE": Kept((), (whole(1, 30, 2),), "12"),
    "INTSEL": Kept((), (whole(0, 2),), "1"),
    "WEBLOG": Kept((), (words(NAME), words(NAME)), "user,user"),
    "OPSTE": Kept((), (whole(0, 255, 3),), "0"),
    "NET": Kept(
        (),
        (ON, ON, *ADDRESSES, words(15), words(64, padded=False), words(32, padded=False)),
        "0,0,192.168.0.12,255.255.255.0,0.0.0.0,0.0.0.0,0.0.0.0,LSCI-336,,",
    ),
}
HEADER: tuple[Field, ...] = (
    words(NAME),
    words(SERIAL),
    whole(1, 4),
    real(0.0, 9999.0),
    whole(1, 2),
)
OF_THE_MAKER: Mapping[int, str] = {
    1: "DT-470,STANDARD C,2,475,1",
    2: "DT-670,STANDARD C,2,500,1",
    PT100: "PT-100,STANDARD C,3,800,2",
    7: "PT-1000,STANDARD C,3,800,2",
}
"""Headers of the maker's curves that a public list names; the others are empty here."""
EMPTY = ",,3,375,1"
POINT = real(-9999.0, 99999.0, "+.6g")


def channel(text: str) -> str:
    """Return a field that is an input."""
    if text.strip().upper() not in tuple("ABCD"):
        raise RefusedCommand(EXECUTION_ERROR)
    return text.strip().upper()


def parts_of(text: str) -> list[str]:
    """Return what stands between the commas of a command; a text may have commas of its own."""
    parts = [""]
    quoted = False
    for letter in text:
        if letter == '"':
            quoted = not quoted
        elif letter == "," and not quoted:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def shown(fields: Sequence[Field], values: Sequence[str]) -> list[str]:
    """Return the values of fields as they are answered; RefusedCommand for one too few or many."""
    if len(values) != len(fields):
        raise RefusedCommand(EXECUTION_ERROR)
    return [read(value) for read, value in zip(fields, values, strict=True)]


class Settings:
    """The kept settings, by name and what they are asked by."""

    def __init__(self) -> None:
        self._values: dict[tuple[str, ...], list[str]] = {}

    def put(self, name: str, text: str) -> None:
        """Take what a command has behind its name."""
        key, values = self._split(name, text)
        old = self.values(name, *key)
        if len(values) != len(old):
            raise RefusedCommand(EXECUTION_ERROR)
        values = [value or kept for value, kept in zip(values, old, strict=True)]
        self._values[name, *key] = shown(SETTINGS[name].fields, values)

    def answer(self, name: str, text: str) -> str:
        """Return what a question is answered with."""
        key, values = self._split(name, text)
        if any(values):
            raise RefusedCommand(EXECUTION_ERROR)
        return ",".join(self.values(name, *key))

    def values(self, name: str, *key: str) -> list[str]:
        """Return the fields of a setting."""
        kept = SETTINGS[name]
        at_first = shown(kept.fields, parts_of(kept.at_first))
        return self._values.get((name, *key), at_first)

    @staticmethod
    def _split(name: str, text: str) -> tuple[list[str], list[str]]:
        parts, wanted = parts_of(text), SETTINGS[name].keys
        key = [part.upper() for part in parts[: len(wanted)]]
        if len(key) < len(wanted) or not all(
            part in tuple(places) for part, places in zip(key, wanted, strict=True)
        ):
            raise RefusedCommand(EXECUTION_ERROR)
        return key, parts[len(wanted) :]


class Curves:
    """The curves that turn what a sensor has into a temperature."""

    def __init__(self) -> None:
        self._headers: dict[int, list[str]] = {}
        self._points: dict[int, dict[int, tuple[str, ...]]] = {}

    def header(self, text: str) -> str:
        """Return the header of a curve."""
        return ",".join(self._header(number_of(CURVES, text)))

    def put_header(self, text: str) -> None:
        """Take the header of a user's curve."""
        number, *values = parts_of(text)
        self._headers[number_of(USER_CURVES, number)] = shown(HEADER, values)

    def point(self, text: str) -> str:
        """Return a point of a curve, zeros where it has none."""
        number, index, *_ = [*parts_of(text), "", ""]
        of_curve = self._points.get(number_of(CURVES, number), {})
        return ",".join(of_curve.get(number_of(POINTS, index), (POINT("0"), POINT("0"))))

    def put_point(self, text: str) -> None:
        """Take a point of a user's curve: sensor, kelvin and, where it is a spline, curvature."""
        parts = parts_of(text)
        if not 4 <= len(parts) <= 5:
            raise RefusedCommand(EXECUTION_ERROR)
        number, index, *values = parts
        of_curve = self._points.setdefault(number_of(USER_CURVES, number), {})
        of_curve[number_of(POINTS, index)] = tuple(POINT(value) for value in values)

    def delete(self, text: str) -> None:
        """Forget a user's curve."""
        number = number_of(USER_CURVES, text)
        self._headers.pop(number, None)
        self._points.pop(number, None)

    def reading_K(self, number: int, ohm: float) -> float | None:
        """Return what a user's curve makes of a resistance; None beyond its points."""
        points = [
            (float(sensor), float(kelvin))
            for sensor, kelvin, *_ in self._points.get(number, {}).values()
            if float(kelvin) != 0.0
        ]
        by_log = int(self._header(number)[2]) == LOG_OHM
        sensed = math.log10(ohm) if by_log and ohm > 0.0 else ohm
        points.sort()
        if len(points) < 2 or not points[0][0] <= sensed <= points[-1][0]:
            return None
        return float(np.interp(sensed, *np.array(points).T))

    def _header(self, number: int) -> list[str]:
        at_first = shown(HEADER, parts_of(OF_THE_MAKER.get(number, EMPTY)))
        return self._headers.get(number, at_first)


def number_of(numbers: range, text: str) -> int:
    """Return a whole number out of a range; RefusedCommand for none."""
    return int(whole(numbers[0], numbers[-1])(text))
