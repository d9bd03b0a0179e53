"""Results that are curves over temperature, as a certificate states them: formula and table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from station.report.certificate_cmc import cmc_of, smallest_printed
from station.report.numbers import format_with_uncertainty, last_place, rounded, typeset
from station.uncertainty import coverage_factor

if TYPE_CHECKING:
    from station.instruments.laboratory import Laboratory
    from station.results import Result, ResultDocument

Table = tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...], str]
"""Title, columns, rows and the sentence below them."""
STEPS_DEGC = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
MOST_ROWS = 12
FINER = 2
"""So many more digits than U have the coefficients."""
HOLDS_WITHIN = (
    "The curve y over the temperature T of its thermometer, in degC. It holds within this range "
    "and nowhere else."
)
NO_U_ALONG = "U is known where the result is stated, and not along the curve."


@dataclass(frozen=True)
class Point:
    """A curve at a temperature, with its expanded uncertainty there, in its unit."""

    temperature_degC: float
    value: float
    expanded: float
    coverage_factor: float


@dataclass(frozen=True)
class Curve:
    """A result over temperature: its formula in t, t of the temperature T, and its points.

    There are points where U is known along it.
    """

    axis: str | None
    formula: str
    scaled: str
    span: str
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Curves:
    """The curves of all axes of a result, with points at the same temperatures."""

    name: str
    unit: str
    curves: tuple[Curve, ...]

    def tables(self) -> Iterator[Table]:
        """Yield the formulas as a table, then the points where there are any."""
        columns = ("Axis", f"y in {self.unit}", "t", "T in degC")
        rows = tuple((c.axis or "", c.formula, c.scaled, c.span) for c in self.curves)
        known = [curve for curve in self.curves if curve.points]
        caption = HOLDS_WITHIN if known else f"{HOLDS_WITHIN} {NO_U_ALONG}"
        yield f"{self.name} over temperature", columns, rows, caption
        if known:
            yield self._values(known)

    def _values(self, known: Sequence[Curve]) -> Table:
        axes = [curve.axis or "y" for curve in known]
        columns = ("T in degC", *(text for axis in axes for text in (axis, f"U({axis})")))
        rows = []
        for points in zip(*(curve.points for curve in known), strict=True):
            each = (format_with_uncertainty(point.value, point.expanded) for point in points)
            temperature = typeset(f"{points[0].temperature_degC:g}")
            rows.append((temperature, *(text for texts in each for text in texts)))
        caption = (
            f"Values and U in {self.unit}. U holds at each temperature by itself, for a coverage "
            "of 95 %; that no part of a whole curve is farther off needs a larger factor."
        )
        return f"{self.name} at temperatures", columns, tuple(rows), caption


def curves_of(document: ResultDocument, laboratory: Laboratory | None = None) -> Iterator[Curves]:
    """Yield each result that is a Chebyshev curve over temperature.

    No U of its points is below the CMC of its laboratory.
    """
    curves: dict[str, list[Result]] = {}
    for result in document.results:
        model = result.estimate.extra.get("model")
        if isinstance(model, dict) and model.get("basis") == "chebyshev":
            curves.setdefault(result.estimate.words, []).append(result)
    for name, results in curves.items():
        known = [result for result in results if result.estimate.extra.get("band")]
        heat_degC = _round_temperatures(known) if known else []
        each = tuple(_curve(result, heat_degC, laboratory) for result in results)
        yield Curves(name, results[0].estimate.unit, each)


def _curve(result: Result, heat_degC: Sequence[float], laboratory: Laboratory | None) -> Curve:
    low, high = result.estimate.extra["model"]["domain"]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    sign = "+" if middle < 0 else "−"
    scaled = f"t = (T {sign} {abs(middle):.6g})/{half:.6g}"
    span = f"{low:.1f} … {high:.1f}".replace("-", "−")
    points: tuple[Point, ...] = ()
    if result.estimate.extra.get("band"):
        cmc = smallest_printed(cmc_of(laboratory, result)) or 0.0
        points = tuple(_point(result, temperature_degC, cmc) for temperature_degC in heat_degC)
    return Curve(result.estimate.axis, _polynomial(result), scaled, span, points)


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
        if n and float(digits) == 0.0:
            continue
        sign = "" if not text else " + "
        if digits.startswith("-"):
            digits, sign = digits[1:], " − " if text else "−"
        text += f"{sign}{digits}" + ("" if n == 0 else " t" if n == 1 else f" t^{n}")
    return text


def _expanded(result: Result) -> list[float]:
    band: dict[str, list[float]] = result.estimate.extra.get("band") or {}
    return band.get("expanded_uncertainty", [])


def _round_temperatures(results: Sequence[Result]) -> list[float]:
    """Return round temperatures in degC that all curves have."""
    low = max(result.estimate.extra["model"]["domain"][0] for result in results)
    high = min(result.estimate.extra["model"]["domain"][1] for result in results)
    step = next((step for step in STEPS_DEGC if (high - low) / step < MOST_ROWS), STEPS_DEGC[-1])
    return [step * n for n in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _point(result: Result, temperature_degC: float, cmc: float) -> Point:
    """Return a curve and its U at a temperature, that of all its budget included.

    What depends on the thermometer grows with the slope there; what else is of type B is that of
    the budget at every temperature. Where the result itself is stated, U is that of the result.
    """
    import numpy as np
    from numpy.polynomial import Chebyshev

    extra: Any = result.estimate.extra
    model, band = extra["model"], extra["band"]
    curve = Chebyshev(model["coefficients"], model["domain"])
    standard, expanded = (
        float(np.interp(temperature_degC, band["temperature_degC"], band[name]))
        for name in ("standard_uncertainty", "expanded_uncertainty")
    )
    value, combined = float(curve(temperature_degC)), result.combined
    if combined is not None and result.estimate.holds_at == f"{temperature_degC:g} degC":
        expanded = max(combined.expanded_uncertainty, cmc)
        return Point(temperature_degC, value, expanded, combined.coverage_factor)
    by_degC = float(curve.deriv()(temperature_degC))
    parts = [
        (by_degC * (line.standard_uncertainty or 0.0), line.degrees_of_freedom)
        if line.unit == "degC"
        else (line.contribution, line.degrees_of_freedom)
        for line in result.budget
        if line.kind == "B"
    ]
    own = [line.degrees_of_freedom for line in result.budget if line.kind == "A"]
    factor, u = expanded / standard if standard else 1.0, standard
    if own and standard:
        parts.append((standard, own[0]))
        u = math.hypot(*(part for part, _ in parts))
        factor = coverage_factor(u**4 / spread if (spread := _spread(parts)) else math.inf)
    return Point(temperature_degC, value, max(factor * u, cmc), factor)


def _spread(parts: Sequence[tuple[float, float]]) -> float:
    """Return what the effective degrees of freedom divide (Welch-Satterthwaite; GUM, G.4)."""
    return sum(part**4 / dof for part, dof in parts if math.isfinite(dof))
