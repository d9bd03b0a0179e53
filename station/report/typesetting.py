"""Units as they are set on paper and in pictures; in files and on the wire they stay ASCII."""

from __future__ import annotations

import re

from station.report.numbers import RAISED
from station.texts import AsTyped

SIGNS = {
    r"degC\b": "°C",
    r"ohm\b": "Ω",
    r"u(?=(?:T|V|A|g|m|W|rad)\b)": "µ",
    r"us(?<=\d us)": "µs",
}
"""Names of units, or the beginning of one, with the sign that stands for it."""
ROOT = r"sqrt\((?P<root>\w+)\)"
POWER = r"(?<=[\w)])\^(?P<power>-?\d+)"
EXPONENT = r"(?<![\w.])(?P<mantissa>\d+(?:\.\d+)?)e(?P<exponent>[-+]\d+)(?!\w)"
TYPED = "`[^`]*`"
"""What is typed at a terminal or stands in a file: it stays as it is."""
_NAMES = "|".join(rf"(?P<s{n}>(?<![A-Za-z_]){name})" for n, name in enumerate(SIGNS))
_UNITS = re.compile(rf"{TYPED}|{ROOT}|{POWER}|{EXPONENT}|(?:{_NAMES})(?!_)")
_BY_GROUP = {f"s{n}": sign for n, sign in enumerate(SIGNS.values())}


def with_signs(text: str) -> str:
    """Return a text with typeset units and powers of ten.

    `V/g^2` is V/g², `deg/sqrt(h)` deg/√h, `degC` °C, `4.6e-05` 4.6·10⁻⁵. What a person typed stays.
    """
    return text if isinstance(text, AsTyped) else _UNITS.sub(_sign, text)


def _sign(match: re.Match[str]) -> str:
    group = match.lastgroup
    if group == "root":
        return f"√{match['root']}"
    if group == "power":
        return match["power"].translate(RAISED)
    if group == "exponent":
        return f"{match['mantissa']}·10{str(int(match['exponent'])).translate(RAISED)}"
    return _BY_GROUP.get(group or "", match.group())
