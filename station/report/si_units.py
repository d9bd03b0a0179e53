"""Units as the D-SI writes them: `\\degree\\hour\\tothe{-1}`, for digital certificates.

What the SI does not know is converted: `g` is standard gravity, `G` is 0.1 mT, `ppm` is 10⁻⁶.
Source: SmartCom, "Digital System of Units (D-SI)", units in the notation of siunitx.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from fractions import Fraction

BASES: Mapping[str, str] = {
    "T": r"\tesla",
    "V": r"\volt",
    "A": r"\ampere",
    "W": r"\watt",
    "H": r"\henry",
    "ohm": r"\ohm",
    "Hz": r"\hertz",
    "Pa": r"\pascal",
    "m": r"\metre",
    "s": r"\second",
    "min": r"\minute",
    "h": r"\hour",
    "d": r"\day",
    "deg": r"\degree",
    "arcmin": r"\arcminute",
    "arcsec": r"\arcsecond",
    "rad": r"\radian",
    "K": r"\kelvin",
    "degC": r"\kelvin",
    "%": r"\percent",
}
PREFIXES: Mapping[str, str] = {
    "M": r"\mega",
    "k": r"\kilo",
    "h": r"\hecto",
    "c": r"\centi",
    "m": r"\milli",
    "u": r"\micro",
    "n": r"\nano",
}
PREFIXED = frozenset(["T", "V", "A", "W", "H", "Hz", "Pa", "m", "s"])
GRAVITY: Mapping[str, int] = {r"\metre": 1, r"\second": -2}
OTHERS: Mapping[str, tuple[Fraction, Mapping[str, int]]] = {
    "1": (Fraction(1), {}),
    "ppm": (Fraction(1, 10**6), {}),
    "g": (Fraction("9.80665"), GRAVITY),
    "mg": (Fraction("9.80665e-3"), GRAVITY),
    "ug": (Fraction("9.80665e-6"), GRAVITY),
    "G": (Fraction(1, 10**4), {r"\tesla": 1}),
}
"""What is no SI unit: its size, and the powers that it is a multiple of."""
ALONE: Mapping[str, str] = {
    "degC": r"\degreecelsius",
    "°C": r"\degreecelsius",
    "% RH": r"\percent",
}
"""Units that read otherwise where they stand alone."""
_PART = re.compile(r"sqrt\((?P<root>[^()]+)\)|\((?P<group>[^()]+)\)|(?P<unit>[^/^()]+)")
_POWER = re.compile(r"\^(\d+)")


def si_unit(unit: str) -> tuple[str, float] | None:
    """Return a unit in D-SI notation and what a number in it is multiplied by; None if unknown."""
    if unit in ALONE:
        return ALONE[unit], 1.0
    try:
        size, powers = _product(unit)
    except KeyError:
        return None
    text = "".join(name + _raised(power) for name, power in powers.items() if power)
    return text or r"\one", size


def _raised(power: Fraction) -> str:
    return "" if power == 1 else rf"\tothe{{{float(power):g}}}"


def _product(unit: str) -> tuple[float, dict[str, Fraction]]:
    """Return the size and the powers of a product such as `deg/h/sqrt(h)`; KeyError if unknown."""
    size, powers = 1.0, defaultdict[str, Fraction](Fraction)
    for part, power in _factors(unit):
        factor, names = part
        size *= float(factor) ** float(power)
        for name, exponent in names.items():
            powers[name] += exponent * power
    return size, dict(powers)


def _factors(unit: str) -> Iterator[tuple[tuple[float, Mapping[str, Fraction]], Fraction]]:
    at, sign = 0, 1
    while at < len(unit):
        part = _PART.match(unit, at)
        if part is None:
            raise KeyError(unit)
        at, power = part.end(), Fraction(sign)
        if part["root"]:
            yield _product(part["root"]), power / 2
        elif part["group"]:
            yield _product(part["group"]), power
        else:
            raised = _POWER.match(unit, at)
            if raised:
                at, power = raised.end(), power * int(raised[1])
            yield _single(part["unit"]), power
        if at < len(unit) and unit[at] != "/":
            raise KeyError(unit)
        at, sign = at + 1, -1


def _single(name: str) -> tuple[float, Mapping[str, Fraction]]:
    if name in OTHERS:
        size, powers = OTHERS[name]
        return float(size), {base: Fraction(power) for base, power in powers.items()}
    if name in BASES:
        return 1.0, {BASES[name]: Fraction(1)}
    prefix, base = name[:1], name[1:]
    if base not in PREFIXED:
        raise KeyError(name)
    return 1.0, {PREFIXES[prefix] + BASES[base]: Fraction(1)}
