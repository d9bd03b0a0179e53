"""Results that are curves over temperature, as a certificate states them: formula and table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from station.report.certificate_cmc import cmc_of
from station.report.numbers import format_with_uncertainty, last_place, rounded, typeset

if TYPE_CHECKING:
    from station.instruments.laboratory import Laboratory
    from station.results import Result, ResultDocument

Table = tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...], str]
"""Title, columns, rows and the sentence below them."""
STEPS_DEGC = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
MOST_ROWS = 12
FINER = 2
"""So many more digits than U have the coefficients."""


def curve_tables(document: ResultDocument, laboratory: Laboratory | None = None) -> Iterator[Table]:
    """Yield formula and table of each result that is a Chebyshev curve over temperature.

    No U of a table is below the CMC of its laboratory.
    """
    curves: dict[str, list[Result]] = {}
    for result in document.results:
        model = result.estimate.extra.get("model")
        if isinstance(model, dict) and model.get("basis") == "chebyshev":
            curves.setdefault(result.estimate.measures.replace("_", " "), []).append(result)
    for name, results in curves.items():
        yield _formulas(name, results)
        known = [result for result in results if result.estimate.extra.get("band")]
        if known:
            yield _values(name, known, [cmc_of(laboratory, result) or 0.0 for result in known])


def _formulas(name: str, results: Sequence[Result]) -> Table:
    rows = []
    for result in results:
        low, high = result.estimate.extra["model"]["domain"]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        sign = "+" if middle < 0 else "−"
        scaled = f"t = (T {sign} {abs(middle):.6g})/{half:.6g}"
        span = f"{low:.1f} … {high:.1f}".replace("-", "−")
        rows.append((result.estimate.axis or "", _polynomial(result), scaled, span))
    columns = ("Axis", f"y in {results[0].estimate.unit}", "t", "T in degC")
    caption = (
        "The curve y over the temperature T of its thermometer, in degC. It holds within this "
        "range and nowhere else."
    )
    return f"{name} over temperature", columns, tuple(rows), caption


def _polynomial(result: Result) -> str:
    """Return a curve by powers of t, rounded well below its uncertainty."""
    from numpy.polynomial.chebyshev import cheb2poly

    powers = cheb2poly(result.estimate.extra["model"]["coefficients"])
    smallest = min([*_expanded(result), result.expanded_uncertainty or math.inf])
    text = ""
    for n, power in enumerate(map(float, powers)):
        digits = f"{power:.6g}"
        if math.isfinite(smallest) and smallest > 0:
            digits = rounded(power, last_place(smallest, 1) - FINER)
        sign = "" if not text else " + "
        if digits.startswith("-"):
            digits, sign = digits[1:], " − " if text else "−"
        text += f"{sign}{digits}" + ("" if n == 0 else " t" if n == 1 else f" t^{n}")
    return text


def _expanded(result: Result) -> list[float]:
    band: dict[str, list[float]] = result.estimate.extra.get("band") or {}
    return band.get("expanded_uncertainty", [])


def _values(name: str, results: Sequence[Result], smallest: Sequence[float]) -> Table:
    """Return the curves with U at round temperatures that all of them have."""
    unit = results[0].estimate.unit
    low = max(result.estimate.extra["model"]["domain"][0] for result in results)
    high = min(result.estimate.extra["model"]["domain"][1] for result in results)
    step = next((step for step in STEPS_DEGC if (high - low) / step < MOST_ROWS), STEPS_DEGC[-1])
    first, last = math.ceil(low / step), math.floor(high / step)
    axes = [result.estimate.axis or "y" for result in results]
    columns = ["T in degC", *(text for axis in axes for text in (axis, f"U({axis})"))]
    rows = []
    for temperature_degC in (step * n for n in range(first, last + 1)):
        each = zip(results, smallest, strict=True)
        texts = (text for result, cmc in each for text in _at(result, temperature_degC, cmc))
        rows.append((typeset(f"{temperature_degC:g}"), *texts))
    caption = (
        f"Values and U in {unit}. U holds at each temperature by itself, for a coverage of 95 %; "
        "that no part of a whole curve is farther off needs a larger factor."
    )
    return f"{name} at temperatures", tuple(columns), tuple(rows), caption


def _at(result: Result, temperature_degC: float, cmc: float) -> tuple[str, str]:
    """Return a curve and its U at a temperature, that of the thermometer included."""
    import numpy as np
    from numpy.polynomial import Chebyshev

    extra: Any = result.estimate.extra
    model, band = extra["model"], extra["band"]
    curve = Chebyshev(model["coefficients"], model["domain"])
    standard, expanded = (
        float(np.interp(temperature_degC, band["temperature_degC"], band[name]))
        for name in ("standard_uncertainty", "expanded_uncertainty")
    )
    by_degC = float(curve.deriv()(temperature_degC))
    u_degC = math.hypot(
        *(line.standard_uncertainty or 0.0 for line in result.budget if line.unit == "degC")
    )
    whole = expanded / standard * math.hypot(standard, by_degC * u_degC) if standard else expanded
    return format_with_uncertainty(float(curve(temperature_degC)), max(whole, cmc))
