"""What this procedure adds to the report: curves, residuals, proof, and the compensation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial.chebyshev import cheb2poly

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.common.places import table_of
from station.findings import Findings
from station.parts import Part, Table, first_rows
from station.plots import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    VERMILION,
    Axis,
    Item,
    Line,
    Panel,
    Plot,
    Points,
    Rule,
)
from station.plots import Band as Shade
from station.report.numbers import NOTHING, format_limit, format_number, format_with_uncertainty
from station.results import ResultDocument

from .analysis import FogAnalysis
from .curve import Band
from .dataset import Array, FogDataset
from .navigation import POSITION, VELOCITY, Navigated
from .solution import AxisFit
from .verification import Driven, Verified

TABLE_STEP_DEGC = 5.0
COLOURS = {"x": BLUE, "y": VERMILION, "z": GREEN}
GRID = 201
EDGE_SIGMA = 5.0
ROOM = 1.15

Column = tuple[str, tuple[Item, ...], tuple[Item, ...], float]
"""An axis, what is drawn above and below, and how far the lower panel reaches."""


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: curves first, then proof and compensation."""
    analysis: FogAnalysis = findings.detail.analysis
    dataset: FogDataset = findings.detail.dataset
    bias_deg_per_h = dataset.gyro_bias_deg_per_h or 0.0
    fitted = [fit for fit in analysis.fits.values() if fit.curve is not None]
    parts: list[Part] = [_curves(analysis)]
    if dataset.history:
        parts.append(_temperatures(dataset))
    if fitted:
        parts.append(_errors(fitted, analysis, bias_deg_per_h))
    parts.append(_before_and_after(analysis, document))
    if analysis.verified:
        parts.append(_verification(analysis.verified))
    if analysis.driven is not None:
        reference = dataset.drive.heading_deg if dataset.drive is not None else None
        parts.append(_drive(analysis.driven, reference))
    if analysis.navigated is not None:
        parts.append(_navigated(analysis.navigated))
    if fitted:
        parts += _polynomials(fitted)
        parts.append(_compensation(analysis, bias_deg_per_h))
    if any(len(fit.rejected) for fit in analysis.fits.values()):
        parts.append(_left_out(analysis))
    return (*parts, *table_of(dataset.places))


def _curves(analysis: FogAnalysis) -> Table:
    rows = []
    for axis, fit in analysis.fits.items():
        curve = fit.curve
        if curve is None:
            rows.append([axis, str(len(fit.turns.rows)), *[NOTHING] * 7])
            continue
        low, high = curve.domain_degC
        rows.append(
            [
                axis,
                f"{int(fit.kept.sum())} of {len(fit.turns.rows)}",
                f"{low:.2f} … {high:.2f}",
                str(curve.order),
                format_number(fit.noise_ppm, 3),
                format_number(fit.lag_one_correlation, 2),
                "taken off" if fit.paired else "counted in u",
                format_number(fit.bias_deg_per_h, 2),
                format_number(fit.walk_deg_per_h_per_sqrt_h, 2),
            ]
        )
    return Table(
        "Curves",
        "Robust fit of Chebyshev polynomials of the scaled temperature, the order by the Bayesian "
        "information criterion; the noise is that of one turn. Where turns of both senses stand "
        "side by side the gyro's bias is fitted as a polynomial of temperature and a random walk, "
        "and taken off.",
        [
            "axis",
            "turns used",
            "range, degC",
            "order",
            "noise, ppm",
            "correlation of neighbours",
            "gyro bias",
            "mean bias, deg/h",
            "its walk, deg/h/√h",
        ],
        rows,
    )


def _before_and_after(analysis: FogAnalysis, document: ResultDocument) -> Table:
    rows = []
    for axis, fit in analysis.fits.items():
        if fit.curve is None:
            continue
        heat = fit.turns.temperature_degC[fit.kept]
        size = fit.curve.error_ppm(heat)
        rows.append(_row(axis, "the curve's own turns", size, fit.residual_ppm[fit.kept]))
        verified = analysis.verified.get(axis)
        if verified is not None:
            result = document.result("residual_scale_factor_error", axis)
            row = _row(axis, "verification ramp", verified.before_ppm, verified.after_ppm)
            rows.append([*row[:-2], format_limit(result.limit), str(result.decision.verdict)])
    return Table(
        "Before and after compensation",
        "Errors of turns. A ratio above 1 would mean that the compensation was applied with the "
        "wrong sign. The curve's own turns prove nothing; a verification ramp does.",
        ["axis", "turns", "rms before, ppm", "rms after, ppm", "ratio", "largest", "limit", "held"],
        rows,
    )


def _row(axis: str, name: str, before: Array, after: Array) -> list[str]:
    """Return errors before and after compensation, without a limit and a verdict."""
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    rms = [
        float(np.sqrt(np.mean(errors**2))) if len(errors) else np.nan for errors in (before, after)
    ]
    ratio = rms[1] / rms[0] if rms[0] else np.nan
    largest = float(np.max(np.abs(after))) if len(after) else np.nan
    return [
        axis,
        name,
        *(format_number(value, 3) for value in (*rms, ratio, largest)),
        *[NOTHING] * 2,
    ]


def _compensation(analysis: FogAnalysis, gyro_bias_deg_per_h: float) -> Table:
    bands = {
        axis: Band(fit.curve, gyro_bias_deg_per_h)
        for axis, fit in analysis.fits.items()
        if fit.curve is not None
    }
    ends = np.array([band.curve.domain_degC for band in bands.values()])
    grid = np.arange(
        np.ceil(ends[:, 0].min() / TABLE_STEP_DEGC),
        np.floor(ends[:, 1].max() / TABLE_STEP_DEGC) + 1,
    )
    rows = []
    for heat in grid * TABLE_STEP_DEGC:
        cells = [f"{heat:g}"]
        for band in bands.values():
            at = np.array([heat])
            if not band.curve.holds(float(heat)):
                cells += [NOTHING] * 3
                continue
            value, wide = float(band.curve.error_ppm(at)[0]), float(band.whole_ppm(at)[0])
            cells += format_with_uncertainty(value, float(band.expanded_ppm(at)[0]))
            cells.append(format_number(wide, 2))
        rows.append(cells)
    columns = ["gyro temperature, degC"]
    for axis in bands:
        columns += [f"δ {axis}, ppm", f"U {axis}", f"whole {axis}"]
    return Table(
        "Compensation",
        "A true rate is the measured one over 1 + δ(T), with T the gyro's own temperature, held "
        "at the ends of the range: divide, never multiply. U holds the truth at a temperature by "
        "itself in 95 % of records; ± the column beside it holds it at all temperatures at once. "
        "Files beside the results hold the curve as a table and as source code.",
        columns,
        rows,
    )


def _left_out(analysis: FogAnalysis) -> Table:
    rows = [
        [
            str(fit.turns.rows[n]),
            axis,
            f"{fit.turns.temperature_degC[n]:.2f}",
            format_number(float(fit.residual_ppm[n]), 3),
        ]
        for axis, fit in analysis.fits.items()
        for n in fit.rejected
    ]
    caption = "Rows of the turn table, counted from 0."
    columns = ["row", "axis", "gyro temperature, degC", "turn − curve, ppm"]
    return first_rows("Turns left out", caption, columns, rows)


def _temperatures(dataset: FogDataset) -> Plot:
    lines = tuple(
        Line(
            readings[:, 0] / SECONDS_PER_HOUR,
            readings[:, 1],
            colour=COLOURS.get(name.removeprefix("gyro "), INK),
            width=1.1,
            label=name,
        )
        for name, readings in dataset.history.items()
    )
    heat = Axis("temperature, degC")
    return Plot(
        "Temperatures",
        "Against time. The model's argument is the gyro's own temperature, the mean of before and "
        "after a turn, not the chamber's.",
        (Panel(lines, x=Axis("time, h"), y=heat, legend="above", legend_columns=4),),
        2.7,
    )


def _errors(fitted: list[AxisFit], analysis: FogAnalysis, gyro_bias_deg_per_h: float) -> Plot:
    columns = []
    for fit in fitted:
        reach = EDGE_SIGMA * (fit.noise_ppm or 1.0)
        lower = _residuals(fit, gyro_bias_deg_per_h, reach)
        columns.append((fit.axis, _curve(fit, analysis), lower, reach))
    return Plot(
        "Scale-factor error over temperature",
        "Above: each turn, the curve, and the published rule's. Turns scatter more than their "
        "noise where the gyro's bias has not been taken off yet. Below: what the solution leaves "
        "of each turn, and the curve's bands: the dark one is ±U, which holds the truth at any one "
        "temperature in 95 % of records; the wider one holds the true curve over the whole range "
        "at once in 95 %. Triangles: turns that were left out, at the edge where they lie beyond "
        "it.",
        _axis_by_axis(columns, "scale-factor error, ppm", "residual, ppm"),
        4.6,
        heights=(1.7, 1.0),
        gap_x=0.22,
        gap_y=0.12,
        share_x="column",
    )


def _axis_by_axis(columns: Sequence[Column], above: str, below: str) -> tuple[Panel, ...]:
    """Return two panels for each axis: what was found, and below it what is left, enlarged."""
    panels = []
    for number, (axis, upper, lower, reach) in enumerate(columns):
        if number:
            above = below = ""
        title, legend = f"axis {axis}", "" if number else "best"
        heat, edge = Axis("gyro temperature, degC"), ROOM * reach
        enlarged = Axis(below, low=-edge, high=edge)
        panels += [
            Panel(upper, title=title, y=Axis(above), column=number, legend=legend),
            Panel(lower, x=heat, y=enlarged, row=1, column=number, legend=""),
        ]
    return tuple(panels)


def _curve(fit: AxisFit, analysis: FogAnalysis) -> tuple[Item, ...]:
    """Return the turns, the curve and the published curve."""
    assert fit.curve is not None
    heat = fit.curve.temperatures_degC(GRID)
    turns = _dots(fit.axis, fit.turns.temperature_degC[fit.kept], fit.error_ppm[fit.kept])
    items = (
        replace(turns, opacity=0.6, label="turns"),
        Line(heat, fit.curve.error_ppm(heat), colour=INK, width=1.2, label="curve"),
    )
    published = analysis.published[fit.axis]
    if published is None:
        return items
    values = published.error_ppm(heat)
    rule = Line(heat, values, dashes="--", colour=PURPLE, width=1.2, label="published rule")
    return (*items, rule)


def _residuals(fit: AxisFit, gyro_bias_deg_per_h: float, reach: float) -> tuple[Item, ...]:
    """Return both bands around nothing, the residuals, and rejected turns at the edge."""
    assert fit.curve is not None
    heat = fit.curve.temperatures_degC(GRID)
    band = Band(fit.curve, gyro_bias_deg_per_h)
    out = ~fit.kept & np.isfinite(fit.residual_ppm)
    edge = np.clip(fit.residual_ppm[out], -reach, reach)
    return (
        *(Shade(heat, -u, u) for u in (band.whole_ppm(heat), band.expanded_ppm(heat))),
        _dots(fit.axis, fit.turns.temperature_degC[fit.kept], fit.residual_ppm[fit.kept], 3.5),
        Points(fit.turns.temperature_degC[out], edge, marker="^", colour=ORANGE, size=5.0),
    )


def _dots(axis: str, heat: Array, errors: Array, size: float = 4.0) -> Points:
    return Points(heat, errors, marker=".", colour=COLOURS[axis], size=size)


def _verification(verified: Mapping[str, Verified]) -> Plot:
    columns: list[Column] = []
    for errors in verified.values():
        heat = errors.temperature_degC
        before = Points(heat, errors.before_ppm, marker=".", colour=GREY, size=6.0, label="before")
        after = replace(_dots(errors.axis, heat, errors.after_ppm, 6.0), label="compensated")
        lower = after, Rule(y=0.0, width=0.8)
        reach = float(np.max(np.abs(errors.after_ppm)))
        columns.append((errors.axis, (before, *lower), lower, reach))
    return Plot(
        "Verification ramp",
        "Turn errors of another ramp before and after compensation, below enlarged. None of these "
        "turns was used for the curve.",
        _axis_by_axis(columns, "turn error, ppm", "compensated, ppm"),
        4.2,
        heights=(1.5, 1.0),
        gap_x=0.22,
        gap_y=0.12,
        share_x="column",
    )


def _drive(driven: Driven, reference_deg: Array | None) -> Plot:
    """Return how far the headings lie apart, or from the reference where there is one."""
    raw, compensated = driven.raw_deg, driven.compensated_deg
    if reference_deg is None:
        label = "difference of heading, deg"
        traces = [(raw - compensated, VERMILION, "without less with compensation")]
    else:
        label = "heading error, deg"
        true = np.unwrap(reference_deg, period=360.0)
        start = true - true[0]
        traces = [
            (raw - raw[0] - start, VERMILION, "without compensation"),
            (compensated - compensated[0] - start, BLUE, "with compensation"),
        ]
    minutes = (driven.time_s - driven.time_s[0]) / 60.0
    lines = tuple(Line(minutes, y, colour=colour, label=name) for y, colour, name in traces)
    return Plot(
        "Vehicle test",
        "A drive's rates integrated to heading, the earth's rate taken off, without and with "
        "compensation. Turns in one sense add up the error of the scale factor, turns in both "
        "senses hide it.",
        (Panel(lines, x=Axis("time, min"), y=Axis(label)),),
        2.7,
    )


def _navigated(journey: Navigated) -> Plot:
    """Return the horizontal errors of position and velocity against time."""
    minutes = (journey.time_s - journey.time_s[0]) / 60.0
    panels = []
    for column, (part, label) in enumerate(
        ((POSITION, "position error, m"), (VELOCITY, "velocity error, m/s"))
    ):
        lines = tuple(
            Line(minutes, np.linalg.norm(error[:, part], axis=1), colour=colour, label=name)
            for error, colour, name in (
                (journey.error[0], VERMILION, "without compensation"),
                (journey.error[1], BLUE, "with compensation"),
            )
        )
        legend = "" if column else "best"
        panels.append(
            Panel(lines, x=Axis("time, min"), y=Axis(label), column=column, legend=legend)
        )
    return Plot(
        "Navigation",
        "Horizontal distance from the reference trajectory, and difference from its velocity, of "
        "the drive's rates and specific force navigated without and with compensation.",
        tuple(panels),
        2.7,
        gap_x=0.22,
    )


def _polynomials(fitted: Sequence[AxisFit]) -> list[Part]:
    """Return the curves as formulas and as tables of coefficients."""
    formulas, rows = [], []
    for fit in fitted:
        curve = fit.curve
        assert curve is not None
        low, high = curve.domain_degC
        powers = cheb2poly(curve.coefficients_ppm)
        formula = " ".join(
            f"{power:+.10g}" + ("" if n == 0 else " t" if n == 1 else f" t^{n}")
            for n, power in enumerate(powers)
        )
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        formulas.append([fit.axis, f"(T - {middle:.10g})/{half:.10g}", formula.replace("-", "−")])
        us = np.sqrt(np.diag(curve.covariance))
        rows += [
            [fit.axis, str(n), f"{chebyshev:.10g}", f"{u:.2g}", f"{power:.10g}"]
            for n, (chebyshev, u, power) in enumerate(
                zip(curve.coefficients_ppm, us, powers, strict=True)
            )
        ]
    return [
        Table(
            "Polynomial",
            "The curve as a formula: T is the gyro's own temperature in degC, held at the ends of "
            "the range, at t = −1 and t = 1.",
            ["axis", "t", "δ(T), ppm"],
            formulas,
        ),
        Table(
            "Coefficients",
            "The same polynomial by Chebyshev polynomials of t, with the type A standard "
            "uncertainty of each coefficient, and by powers of t.",
            ["axis", "order", "Chebyshev, ppm", "u, ppm", "power, ppm"],
            rows,
        ),
    ]
