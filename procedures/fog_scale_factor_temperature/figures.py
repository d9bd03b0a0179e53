"""What this procedure adds to the report: curves, residuals, proof, and the compensation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from station.findings import Findings
from station.parts import Part, Plot, Table, first_rows
from station.report.drawing import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    label_above,
    new_figure,
)
from station.report.numbers import NOTHING, format_limit, format_number, format_with_uncertainty
from station.results import ResultDocument

from .analysis import FogAnalysis
from .axis_fit import AxisFit
from .curve import Band
from .dataset import SECONDS_PER_HOUR, Array, FogDataset
from .verification import Driven, Verified

TABLE_STEP_DEGC = 5.0
COLOURS = {"x": BLUE, "y": VERMILION, "z": GREEN}
GRID = 201
MAX_POINTS = 3000
EDGE_SIGMA = 5.0
ROOM = 1.15


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: curves first, then proof and compensation."""
    analysis: FogAnalysis = findings.detail.analysis
    dataset: FogDataset = findings.detail.dataset
    bias_deg_per_h = dataset.gyro_bias_deg_per_h or 0.0
    fitted = [fit for fit in analysis.fits.values() if fit.curve is not None]
    parts: list[Part] = [_curves(analysis)]
    if dataset.history:
        history_text = (
            "Against time. The model's argument is the gyro's own temperature, the mean of before "
            "and after a turn, not the chamber's."
        )
        parts.append(Plot("Temperatures", history_text, temperatures(dataset)))
    if fitted:
        curves_text = (
            "Above: each turn, the curve, and the published rule's. Turns scatter more than their "
            "noise where the gyro's bias has not been taken off yet. Below: what the solution "
            "leaves of each turn, and the curve's bands: the dark one is ±U, which holds the truth "
            "at any one temperature in 95 % of records; the wider one holds the true curve over "
            "the whole range at once in 95 %. Triangles: turns that were left out, at the edge "
            "where they lie beyond it."
        )
        figure = curves(analysis, bias_deg_per_h)
        parts.append(Plot("Scale-factor error over temperature", curves_text, figure))
    parts.append(_before_and_after(analysis, document))
    if analysis.verified:
        verified_text = (
            "Turn errors of another ramp before and after compensation, below enlarged. None of "
            "these turns was used for the curve."
        )
        parts.append(Plot("Verification ramp", verified_text, verification(analysis.verified)))
    if analysis.driven is not None:
        reference = dataset.drive.heading_deg if dataset.drive is not None else None
        drive_text = (
            "A drive's rates integrated to heading, the earth's rate taken off, without and with "
            "compensation. Turns in one sense add up the error of the scale factor, turns in both "
            "senses hide it."
        )
        parts.append(Plot("Vehicle test", drive_text, drive(analysis.driven, reference)))
    if fitted:
        parts.append(_compensation(analysis, bias_deg_per_h))
    if any(len(fit.rejected) for fit in analysis.fits.values()):
        parts.append(_left_out(analysis))
    return tuple(parts)


def _curves(analysis: FogAnalysis) -> Table:
    rows = []
    for axis, fit in analysis.fits.items():
        curve = fit.curve
        if curve is None:
            rows.append([axis, str(len(fit.rows)), *[NOTHING] * 7])
            continue
        low, high = curve.domain_degC
        rows.append(
            [
                axis,
                f"{int(fit.kept.sum())} of {len(fit.rows)}",
                f"{low:.2f} … {high:.2f}",
                str(curve.order),
                format_number(fit.noise_ppm, 3),
                format_number(fit.lag_one_correlation, 2),
                "taken off" if fit.paired else "in u",
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
        heat = fit.temperature_degC[fit.kept]
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
            str(fit.rows[n]),
            axis,
            f"{fit.temperature_degC[n]:.2f}",
            format_number(float(fit.residual_ppm[n]), 3),
        ]
        for axis, fit in analysis.fits.items()
        for n in fit.rejected
    ]
    caption = "Rows of the turn table, counted from 0."
    columns = ["row", "axis", "gyro temperature, degC", "turn − curve, ppm"]
    return first_rows("Turns left out", caption, columns, rows)


def temperatures(dataset: FogDataset) -> Figure:
    """Draw all temperatures that were recorded against time."""
    figure = new_figure(2.7)
    axes = figure.add_subplot()
    for name, readings in dataset.history.items():
        step = max(1, len(readings) // MAX_POINTS)
        time_h = readings[::step, 0] / SECONDS_PER_HOUR
        colour = COLOURS.get(name.removeprefix("gyro "), INK)
        axes.plot(time_h, readings[::step, 1], color=colour, linewidth=1.1, label=name)
    axes.set_xlabel("time, h")
    axes.set_ylabel("temperature, degC")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
    return figure


def curves(analysis: FogAnalysis, gyro_bias_deg_per_h: float) -> Figure:
    """Draw, axis by axis, turns, curve, published curve, and the curve's bands, far enlarged."""
    fits = [fit for fit in analysis.fits.values() if fit.curve is not None]
    figure = new_figure(4.6)
    grid = figure.subplots(
        2, len(fits), sharex="col", squeeze=False, gridspec_kw={"height_ratios": (1.7, 1.0)}
    )
    figure.subplots_adjust(wspace=0.22, hspace=0.12)
    for column, fit in enumerate(fits):
        upper, lower = grid[0, column], grid[1, column]
        _curve(upper, fit, analysis)
        _bands(lower, fit, gyro_bias_deg_per_h)
        lower.set_xlabel("gyro temperature, degC")
        label_above(upper, f"axis {fit.axis}")
    grid[0, 0].set_ylabel("scale-factor error, ppm")
    grid[1, 0].set_ylabel("residual, ppm")
    grid[0, 0].legend(loc="best")
    return figure


def _curve(axes: Axes, fit: AxisFit, analysis: FogAnalysis) -> None:
    assert fit.curve is not None
    heat = fit.curve.temperatures_degC(GRID)
    axes.plot(
        fit.temperature_degC[fit.kept],
        fit.error_ppm[fit.kept],
        ".",
        color=COLOURS[fit.axis],
        alpha=0.6,
        markersize=4.0,
        label="turns",
    )
    axes.plot(heat, fit.curve.error_ppm(heat), color=INK, linewidth=1.2, label="curve")
    published = analysis.published[fit.axis]
    if published is not None:
        values = published.error_ppm(heat)
        axes.plot(heat, values, "--", color=PURPLE, linewidth=1.2, label="published rule", zorder=4)


def _bands(axes: Axes, fit: AxisFit, gyro_bias_deg_per_h: float) -> None:
    """Draw the residuals, both bands around nothing, and rejected turns at the edge."""
    assert fit.curve is not None
    heat = fit.curve.temperatures_degC(GRID)
    band = Band(fit.curve, gyro_bias_deg_per_h)
    for wide in (band.whole_ppm(heat), band.expanded_ppm(heat)):
        axes.fill_between(heat, -wide, wide, color=SKY, alpha=0.4, linewidth=0.0, zorder=1)
    axes.plot(
        fit.temperature_degC[fit.kept],
        fit.residual_ppm[fit.kept],
        ".",
        color=COLOURS[fit.axis],
        markersize=3.5,
    )
    out = ~fit.kept & np.isfinite(fit.residual_ppm)
    reach = EDGE_SIGMA * (fit.noise_ppm or 1.0)
    shown = np.clip(fit.residual_ppm[out], -reach, reach)
    axes.plot(fit.temperature_degC[out], shown, "^", color=ORANGE, markersize=5.0)
    axes.set_ylim(-ROOM * reach, ROOM * reach)


def verification(verified: Mapping[str, Verified]) -> Figure:
    """Draw the turn errors of the verification ramp before compensation, and enlarged after it."""
    figure = new_figure(4.2)
    grid = figure.subplots(
        2, len(verified), sharex="col", squeeze=False, gridspec_kw={"height_ratios": (1.5, 1.0)}
    )
    figure.subplots_adjust(wspace=0.22, hspace=0.12)
    for column, axis_errors in enumerate(verified.values()):
        upper, lower = grid[0, column], grid[1, column]
        colour = COLOURS[axis_errors.axis]
        upper.plot(
            axis_errors.temperature_degC, axis_errors.before_ppm, ".", color=GREY, label="before"
        )
        for axes in (upper, lower):
            axes.plot(
                axis_errors.temperature_degC,
                axis_errors.after_ppm,
                ".",
                color=colour,
                label="compensated",
            )
            axes.axhline(0.0, color=INK, linewidth=0.8)
        reach = ROOM * float(np.max(np.abs(axis_errors.after_ppm)))
        lower.set_ylim(-reach, reach)
        lower.set_xlabel("gyro temperature, degC")
        label_above(upper, f"axis {axis_errors.axis}")
    grid[0, 0].set_ylabel("turn error, ppm")
    grid[1, 0].set_ylabel("compensated, ppm")
    grid[0, 0].legend(loc="best")
    return figure


def drive(driven: Driven, reference_deg: Array | None) -> Figure:
    """Draw how far the integrated headings lie apart, and from the reference where there is one."""
    figure = new_figure(2.7)
    axes = figure.add_subplot()
    step = max(1, len(driven.time_s) // MAX_POINTS)
    minutes = (driven.time_s[::step] - driven.time_s[0]) / 60.0
    if reference_deg is None:
        apart = (driven.raw_deg - driven.compensated_deg)[::step]
        axes.plot(minutes, apart, color=VERMILION, label="without less with compensation")
        axes.set_ylabel("difference of heading, deg")
    else:
        true = np.unwrap(reference_deg, period=360.0)
        for heading_deg, colour, name in (
            (driven.raw_deg, VERMILION, "without compensation"),
            (driven.compensated_deg, BLUE, "with compensation"),
        ):
            error = (heading_deg - heading_deg[0]) - (true - true[0])
            axes.plot(minutes, error[::step], color=colour, label=name)
        axes.set_ylabel("heading error, deg")
    axes.set_xlabel("time, min")
    axes.legend(loc="best")
    return figure
