"""How numbers are written for people: as many digits as the uncertainty gives a meaning to."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from decimal import ROUND_HALF_EVEN, Decimal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from station.decision import Limit
    from station.results import Result

UNDETERMINED = "undetermined"
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOTHING = "–"
FIGURE_SPACE = "\u2007"
POINT_SPACE = "\u2008"
PLAIN_EXPONENTS = range(-4, 7)
LAST_PLAIN_PLACE = -12


def format_with_uncertainty(value: float | None, uncertainty: float | None) -> tuple[str, str]:
    """Return the texts of a value and of its uncertainty, both in the same unit.

    The uncertainty keeps two significant digits and the value ends at the same decimal place
    (GUM 7.2.6). A value that is missing or not finite reads "undetermined"; one without an
    uncertainty keeps four significant digits. Very large and very small numbers share one power
    of ten.
    """
    if value is None or not math.isfinite(value):
        return UNDETERMINED, NOTHING
    if uncertainty is None or not math.isfinite(uncertainty):
        return format_number(value), NOTHING
    if uncertainty <= 0:
        return format_number(value, 6), "0"
    place = last_place(uncertainty, 2)
    largest = max(_exponent(value) if value else place, place + 1)
    if largest in PLAIN_EXPONENTS and place >= LAST_PLAIN_PLACE:
        return rounded(value, place), rounded(uncertainty, place)
    shift = Decimal(10) ** -largest
    return tuple(  # type: ignore[return-value]
        f"{rounded(float(Decimal(repr(float(number))) * shift), place - largest)}e{largest}"
        for number in (value, uncertainty)
    )


def format_number(value: float | None, digits: int = 4) -> str:
    """Return a number with this many significant digits, "–" where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0:
        return "0"
    exponent = _exponent(value)
    if exponent in PLAIN_EXPONENTS or 0 <= exponent < digits:
        return rounded(value, last_place(value, digits))
    return f"{value:.{digits - 1}e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def format_like(value: float | None, pattern: str) -> str:
    """Return the value with as many decimals as the text `pattern` has."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if "e" in pattern or not _is_number(pattern):
        return format_number(value)
    return f"{value:.{len(pattern.partition('.')[2])}f}"


def format_limit(limit: Limit | None) -> str:
    """Return a limit as a short formula, "–" where there is none."""
    if limit is None:
        return NOTHING
    texts = []
    if limit.max_abs is not None:
        texts.append(f"|value| ≤ {_bound(limit.max_abs)}")
    if limit.min is not None and limit.max is not None:
        texts.append(f"{_bound(limit.min)} … {_bound(limit.max)}")
    elif limit.min is not None:
        texts.append(f"≥ {_bound(limit.min)}")
    elif limit.max is not None:
        texts.append(f"≤ {_bound(limit.max)}")
    return ", ".join(texts) or NOTHING


def _bound(value: float) -> str:
    return typeset(f"{value:.12g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e"))


def format_degrees_of_freedom(value: float | None) -> str:
    """Return degrees of freedom as people write them: whole from ten on, "∞" when unlimited."""
    if value is None or math.isinf(value) or value > 1e6:
        return "∞"
    return f"{value:.0f}" if value >= 10 else f"{value:.1f}"


def format_result(result: Result) -> tuple[str, str]:
    """Return the texts of a result's value and of its expanded uncertainty."""
    return format_with_uncertainty(result.estimate.value, result.expanded_uncertainty)


def format_duration(seconds: float | None) -> str:
    """Return a duration in the units that a person would say it in."""
    if seconds is None or not math.isfinite(seconds):
        return NOTHING
    if seconds < 60:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {left:02d} s"


def typeset(text: str) -> str:
    """Return a number's text with a minus sign for the hyphen, and its power of ten raised."""
    exponent = re.fullmatch(r"(-?[\d.]+)e(-?\d+)([\s\u2007\u2008]*)", text)
    if exponent:
        mantissa, power, padding = exponent.groups()
        text = f"{mantissa}·10{power.translate(RAISED)}{padding}"
    return text.replace("-", "−") if text[:1] == "-" else text


def align_decimals(texts: Sequence[str]) -> list[str]:
    """Pad the numbers of a column so that, set flush right, their decimal points stand in line.

    Needs figures of one width (tabular); texts that are no numbers stay as they are.
    """
    decimals = [len(text.partition(".")[2]) for text in texts if _is_plain(text)]
    longest = max(decimals, default=0)
    padded = []
    for text in texts:
        if not _is_plain(text) or longest == 0:
            padded.append(text)
            continue
        _, point, fraction = text.partition(".")
        gap = "" if point else POINT_SPACE
        padded.append(text + gap + FIGURE_SPACE * (longest - len(fraction)))
    return padded


def is_numeric_column(texts: Sequence[str]) -> bool:
    """Tell whether a column holds numbers (and blanks) only, so that it is set flush right."""
    filled = [text for text in texts if text not in {"", NOTHING, UNDETERMINED, "∞"}]
    return bool(filled) and all(_is_number(text.partition(" ± ")[0]) for text in filled)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text.replace("−", "-")))
    except ValueError:
        return False


def _is_plain(text: str) -> bool:
    return _is_number(text) and "e" not in text.lower()


def _exponent(value: float) -> int:
    return Decimal(repr(abs(float(value)))).adjusted()


def last_place(value: float, digits: int) -> int:
    """Return the power of ten of the last of so many significant digits, rounding included."""
    exact = Decimal(repr(abs(float(value))))
    place = exact.adjusted() - digits + 1
    rounded = exact.quantize(Decimal(1).scaleb(place), ROUND_HALF_EVEN)
    return rounded.adjusted() - digits + 1


def rounded(value: float, place: int) -> str:
    """Return the value rounded to a power of ten, in plain digits and without a negative zero."""
    exact = Decimal(repr(float(value))).quantize(Decimal(1).scaleb(place), ROUND_HALF_EVEN)
    text = f"{exact:f}" if place <= 0 else f"{Decimal(int(exact)):f}"
    return text.lstrip("-") if not exact else text
