"""The closed table of units: read `0.5 mT`, convert it, write it.

Angle is a dimension of its own, so `deg/h` is never mistaken for a frequency. A temperature and a
temperature difference are two kinds of quantity that are both written `degC`; whoever asks for the
number says which one is meant. `g` is standard gravity.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from difflib import get_close_matches
from fractions import Fraction

ZERO_CELSIUS_K = 273.15

_ARCSEC = Fraction(1, 3600)
_RAD = Fraction(180 / math.pi)
_GRAVITY = Fraction("9.80665")
_HOUR = 3600

# dimension -> (how it is called, an example, {unit: size in the dimension's first unit}).
# Sizes are exact fractions so that 0.5 mT is exactly 0.0005 T and not one bit beside it.
_DIMENSIONS: dict[str, tuple[str, str, dict[str, int | Fraction]]] = {
    "field": (
        "a magnetic field",
        "0.5 mT",
        {
            "T": 1,
            "mT": Fraction(1, 10**3),
            "uT": Fraction(1, 10**6),
            "nT": Fraction(1, 10**9),
            "G": Fraction(1, 10**4),
        },
    ),
    "gradient": ("a field gradient", "20 nT/cm", {"nT/cm": 1}),
    "current": ("a current", "2 A", {"A": 1, "mA": Fraction(1, 10**3)}),
    "voltage": ("a voltage", "5 V", {"V": 1, "mV": Fraction(1, 10**3), "uV": Fraction(1, 10**6)}),
    "resistance": ("a resistance", "100 ohm", {"ohm": 1}),
    "frequency": (
        "a frequency",
        "0.1 Hz",
        {"Hz": 1, "mHz": Fraction(1, 10**3), "kHz": 10**3, "MHz": 10**6},
    ),
    "time": (
        "a time",
        "30 s",
        {
            "s": 1,
            "ms": Fraction(1, 10**3),
            "us": Fraction(1, 10**6),
            "min": 60,
            "h": _HOUR,
            "d": 24 * _HOUR,
        },
    ),
    "angle": (
        "an angle",
        "90 deg",
        {"deg": 1, "arcmin": Fraction(1, 60), "arcsec": _ARCSEC, "rad": _RAD},
    ),
    "rate": (
        "an angular rate",
        "10 deg/s",
        {"deg/s": 1, "deg/h": Fraction(1, _HOUR), "rad/s": _RAD},
    ),
    "angular-acceleration": ("an angular acceleration", "10 deg/s^2", {"deg/s^2": 1}),
    "random-walk": ("an angle random walk", "0.002 deg/sqrt(h)", {"deg/sqrt(h)": 1}),
    "rate-random-walk": ("a rate random walk", "0.01 deg/h/sqrt(h)", {"deg/h/sqrt(h)": 1}),
    "rate-drift": ("a drift of rate", "0.02 deg/h^2", {"deg/h^2": 1}),
    "rate-per-field": ("a magnetic sensitivity of rate", "0.05 deg/h/mT", {"deg/h/mT": 1}),
    "rate-per-field^2": (
        "a quadratic magnetic sensitivity of rate",
        "0.001 deg/h/mT^2",
        {"deg/h/mT^2": 1},
    ),
    "rate-per-temperature": (
        "a temperature coefficient of rate",
        "0.01 deg/h/degC",
        {"deg/h/degC": 1},
    ),
    "rate-per-temperature-slew": (
        "a sensitivity of rate to the rate of temperature",
        "0.4 deg/h/(degC/min)",
        {"deg/h/(degC/min)": 1},
    ),
    "acceleration": (
        "an acceleration",
        "1 g",
        {"m/s^2": 1, "g": _GRAVITY, "mg": _GRAVITY / 10**3, "ug": _GRAVITY / 10**6},
    ),
    "g-sensitivity": ("a sensitivity of rate to specific force", "1 deg/h/g", {"deg/h/g": 1}),
    "ug/g^2": ("a second-order error in g", "50 ug/g^2", {"ug/g^2": 1}),
    "temperature": ("a temperature", "25 degC", {"degC": 1, "K": 1}),
    "temperature-slew": (
        "a rate of temperature",
        "1 degC/min",
        {"degC/min": 1, "degC/h": Fraction(1, 60)},
    ),
    "current-slew": ("a current slew rate", "2 A/s", {"A/s": 1}),
    "inductance": ("an inductance", "10 mH", {"mH": 1}),
    "power": ("a power", "50 W", {"W": 1}),
    "field-per-current": ("a coil constant", "0.25 mT/A", {"mT/A": 1}),
    "field-per-voltage": ("a field per voltage", "50 nT/V", {"nT/V": 1}),
    "gyromagnetic-ratio": ("a gyromagnetic ratio", "28.02495 Hz/nT", {"Hz/nT": 1}),
    "pressure": ("a pressure", "1013 hPa", {"hPa": 1, "kPa": 10}),
    "length": ("a length", "300 mm", {"mm": 1, "m": 1000}),
    "speed": ("a speed", "0.5 m/s", {"m/s": 1}),
    "ratio": (
        "a ratio",
        "0.5 %",
        {"1": 1, "%": Fraction(1, 100), "ppm": Fraction(1, 10**6)},
    ),
    "V/g": ("an accelerometer scale factor", "0.002 V/g", {"V/g": 1}),
    "V/g^2": ("a second-order coefficient", "1e-6 V/g^2", {"V/g^2": 1}),
    "V/g^3": ("a third-order coefficient", "1e-6 V/g^3", {"V/g^3": 1}),
    "V/T": ("a magnetic sensitivity of voltage", "0.01 V/T", {"V/T": 1}),
    "V/T^2": ("a quadratic magnetic sensitivity of voltage", "0.1 V/T^2", {"V/T^2": 1}),
    "V/g/T": ("a magnetic sensitivity of a scale factor", "0.001 V/g/T", {"V/g/T": 1}),
}
_DIMENSION_OF = {unit: name for name, (_, _, sizes) in _DIMENSIONS.items() for unit in sizes}

UNITS: tuple[str, ...] = tuple(_DIMENSION_OF)

# What people type out of habit; the table itself stays small.
_HABITS = {
    "°c": "degC", "℃": "degC", "c": "degC", "celsius": "degC", "deg c": "degC", "degc": "degC",
    "kelvin": "K", "°": "deg", "degree": "deg", "degrees": "deg", "°/h": "deg/h", "°/s": "deg/s",
    "dps": "deg/s", "deg/hr": "deg/h", "ω": "ohm", "ohms": "ohm", "sec": "s", "second": "s",
    "seconds": "s", "minute": "min", "minutes": "min", "min": "min", "mins": "min",
    "hr": "h", "hour": "h", "hours": "h", "day": "d", "days": "d", "gs": "G", "gauss": "G",
    "tesla": "T", "volt": "V", "amp": "A", "ampere": "A", "hertz": "Hz", "percent": "%",
    "arcsec/s": "deg/h", "'": "arcmin", '"': "arcsec", "°c/min": "degC/min", "k/min": "degC/min",
    "deg/√h": "deg/sqrt(h)",
}  # fmt: skip

LARGEST, SMALLEST = 1e18, 1e-30
BEYOND = "beyond anything that a bench can set or measure"

_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")


class UnitError(ValueError):
    """A quantity that cannot be used as it is written.

    `what` is the sentence, `hint` what to write instead (or None).
    """

    def __init__(self, what: str, hint: str | None = None) -> None:
        super().__init__(f"{what}; did you mean {hint}" if hint else what)
        self.what = what
        self.hint = hint


@dataclass(frozen=True)
class Quantity:
    """A number with its unit."""

    value: float
    unit: str

    def to(self, unit: str, *, difference: bool = False) -> float:
        """Return the number in another unit; raise UnitError when the dimension differs."""
        return convert(self.value, self.unit, unit, difference=difference)

    def __str__(self) -> str:
        return format_quantity(self.value, self.unit)


def dimension_of(unit: str) -> str:
    """Return the name of a unit's dimension; raise UnitError for a unit outside the table."""
    try:
        return _DIMENSION_OF[unit]
    except KeyError:
        raise UnitError(f"unit '{unit}' is not known", _likely_unit(unit)) from None


def expectation(unit: str, *, difference: bool = False) -> str:
    """Say in words what a value in this unit is, with an example: `a time such as '30 s'`.

    `difference` says so of a temperature that is one; what else is measured knows no other zero.
    """
    noun, example, _ = _DIMENSIONS[dimension_of(unit)]
    if difference and dimension_of(unit) == "temperature":
        noun, example = "a temperature difference", "0.5 degC"
    return f"{noun} such as '{example}'"


def convert(value: float, unit: str, to_unit: str, *, difference: bool = False) -> float:
    """Convert a number from one unit to another of the same dimension.

    `difference` treats degC and K as temperature differences, which have no zero point.
    Raise UnitError for an unknown unit or another dimension.
    """
    dimension = dimension_of(unit)
    if dimension_of(to_unit) != dimension:
        is_noun, wanted = _DIMENSIONS[dimension][0], expectation(to_unit)
        raise UnitError(f"'{format_quantity(value, unit)}' is {is_noun}, expected {wanted}")
    if unit == to_unit:
        return value
    if dimension == "temperature":
        if difference:
            return value
        return value + ZERO_CELSIUS_K if unit == "degC" else value - ZERO_CELSIUS_K
    sizes = _DIMENSIONS[dimension][2]
    ratio = Fraction(sizes[unit]) / Fraction(sizes[to_unit])
    # Multiplying and dividing by whole numbers rounds less than one multiplication by a ratio
    # that has no exact binary form: 0.5 mT / 1000.
    return value * ratio.numerator / ratio.denominator


def parse_quantity(text: str) -> Quantity:
    """Read a number, blanks and a unit of the table.

    Raise UnitError that says what is wrong: no unit, an unknown unit, no number.
    """
    stripped = text.strip()
    number = _NUMBER.match(stripped)
    if number is None:
        raise UnitError(f"'{text}' is not a number with a unit", _plain_number(stripped))
    value = float(number.group())
    rest = stripped[number.end() :]
    unit = rest.strip()
    if not unit:
        raise UnitError(f"'{text}' has no unit")
    if unit != "1" and unit[0] in ",.0123456789":
        raise UnitError(f"'{text}' is not a number with a unit", _plain_number(stripped))
    if unit not in _DIMENSION_OF:
        likely = _likely_unit(unit)
        hint = f"'{number.group()} {likely}'" if likely else None
        raise UnitError(f"'{text}' has a unit that is not known, '{unit}'", hint)
    if rest == unit:
        hint = f"'{number.group()} {unit}'"
        raise UnitError(f"'{text}' lacks the blank between number and unit", hint)
    if not math.isfinite(value):
        raise UnitError(f"'{text}' is too large to be a number")
    return Quantity(value, unit)


def parse_as(text: object, unit: str, *, difference: bool = False) -> float:
    """Read a quantity and return its number in `unit`.

    A number alone is accepted only where `unit` is `1`.
    Raise UnitError that says what was expected.
    """
    wanted = expectation(unit, difference=difference)
    if isinstance(text, (int, float)) and not isinstance(text, bool):
        if abs(text) >= LARGEST:
            raise UnitError(f"{text:.3g} is {BEYOND}, expected {wanted}")
        if dimension_of(unit) == "ratio" and unit == "1" and math.isfinite(text):
            return float(text)
        hint = f"'{format_quantity(text, unit)}'" if math.isfinite(text) else None
        raise UnitError(f"{text} has no unit, expected {wanted}", hint)
    if not isinstance(text, str):
        raise UnitError(f"expected {wanted}, not {_kind(text)}")
    try:
        quantity = parse_quantity(text)
    except UnitError as error:
        if text.strip() and _NUMBER.fullmatch(text.strip()) and error.hint is None:
            hint = f"'{text.strip()} {unit}'"
            raise UnitError(f"{error.what}, expected {wanted}", hint) from None
        hint = error.hint if _fits(error.hint, unit) else None
        raise UnitError(f"{error.what}, expected {wanted}", hint) from None
    if dimension_of(quantity.unit) != dimension_of(unit):
        noun = _DIMENSIONS[dimension_of(quantity.unit)][0]
        raise UnitError(f"'{text}' is {noun}, expected {wanted}")
    value = quantity.to(unit, difference=difference)
    if abs(value) >= LARGEST or 0.0 < abs(value) <= SMALLEST:
        raise UnitError(f"'{text}' is {BEYOND}, expected {wanted}")
    return value


def format_quantity(value: float, unit: str) -> str:
    """Write a number with its unit so that `parse_quantity` reads the same number again."""
    number = repr(float(value))
    return f"{number.removesuffix('.0')} {unit}"


SHOWN_IN = {"T": ("mT", 1e3)}
"""Fields are set, read and plotted in one unit."""
PREFIXES = (("m", 1e3), ("u", 1e6), ("n", 1e9))
PREFIXED = ("A", "V", "W", "s", "ohm")
"""Whose small values are shown with a prefix."""


def shown_in(unit: str) -> tuple[str, float]:
    """Return the unit in which values of a unit are shown, and what they are multiplied by."""
    return SHOWN_IN.get(unit, (unit, 1.0))


def shown(value: float, unit: str) -> str:
    """Return a value with its unit as people read it: `-0.554 mA`, never `-0.000554 A`."""
    unit, factor = shown_in(unit)
    value *= factor
    if unit in PREFIXED and 0.0 < abs(value) < 1.0:
        for prefix, larger in PREFIXES:
            if abs(value) * larger >= 0.1:
                return f"{value * larger:.3g} {prefix}{unit}"
        return f"0 {unit}"
    if 0.0 < abs(value) < 1e-4:
        return f"{value:.1e} {unit}".rstrip()
    return f"{value:.4g} {unit}".rstrip()


def _kind(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    return "a list" if isinstance(value, (list, tuple)) else "a mapping"


def _plain_number(text: str) -> str | None:
    """Return the text with a decimal comma or a typographic minus replaced, if that was all."""
    plain = text.replace("\N{MINUS SIGN}", "-").replace("\N{EN DASH}", "-").replace(",", ".")
    number = _NUMBER.match(plain)
    if plain == text or number is None:
        return None
    return f"'{plain}'" if plain[number.end() :].strip() in _DIMENSION_OF else None


def _likely_unit(unit: str) -> str | None:
    plain = unit.replace("µ", "u").replace("μ", "u").replace("²", "^2").replace("³", "^3")
    plain = plain.replace("**", "^")
    if plain in _DIMENSION_OF:
        return plain
    folded = plain.lower()
    if folded in _HABITS:
        return _HABITS[folded]
    # Milli and mega are never taken for each other.
    possible = [known for known in UNITS if {known[0], plain[0]} != {"m", "M"}]
    same = [known for known in possible if known.lower() == folded]
    close = same or get_close_matches(plain, possible, n=1, cutoff=0.7)
    return close[0] if close else None


def _fits(hint: str | None, unit: str) -> bool:
    """Tell whether a hint, a quoted quantity, has the dimension that was asked for."""
    if hint is None:
        return False
    return dimension_of(parse_quantity(hint.strip("'")).unit) == dimension_of(unit)
