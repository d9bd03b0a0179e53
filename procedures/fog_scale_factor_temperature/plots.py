"""Plots of a gyro over temperature: temperatures, curves with their band, residuals, a drive."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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

from .analysis import FogAnalysis
from .axis_fit import AxisFit
from .curve import Band
from .dataset import SECONDS_PER_HOUR, FogDataset
from .verification import Driven, Verified

COLOURS = {"x": BLUE, "y": VERMILION, "z": GREEN}
GRID = 201
MOST_POINTS = 3000
EDGE_SIGMA = 5.0
ROOM = 1.15


def temperatures(dataset: FogDataset) -> Figure:
    """Draw all temperatures that were recorded against time."""
    figure = new_figure(2.7)
    axes = figure.add_subplot()
    for name, course in dataset.history.items():
        step = max(1, len(course) // MOST_POINTS)
        time_h = course[::step, 0] / SECONDS_PER_HOUR
        colour = COLOURS.get(name.removeprefix("gyro "), INK)
        axes.plot(time_h, course[::step, 1], color=colour, linewidth=1.1, label=name)
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


def verification(verified: dict[str, Verified]) -> Figure:
    """Draw the turn errors of the verification ramp before compensation, and enlarged after it."""
    figure = new_figure(4.2)
    grid = figure.subplots(
        2, len(verified), sharex="col", squeeze=False, gridspec_kw={"height_ratios": (1.5, 1.0)}
    )
    figure.subplots_adjust(wspace=0.22, hspace=0.12)
    for column, one in enumerate(verified.values()):
        upper, lower = grid[0, column], grid[1, column]
        colour = COLOURS[one.axis]
        upper.plot(one.temperature_degC, one.before_ppm, ".", color=GREY, label="before")
        for axes in (upper, lower):
            axes.plot(one.temperature_degC, one.after_ppm, ".", color=colour, label="compensated")
            axes.axhline(0.0, color=INK, linewidth=0.8)
        reach = ROOM * float(np.max(np.abs(one.after_ppm)))
        lower.set_ylim(-reach, reach)
        lower.set_xlabel("gyro temperature, degC")
        label_above(upper, f"axis {one.axis}")
    grid[0, 0].set_ylabel("turn error, ppm")
    grid[1, 0].set_ylabel("compensated, ppm")
    grid[0, 0].legend(loc="best")
    return figure


def drive(driven: Driven, reference_deg: np.ndarray | None) -> Figure:
    """Draw how far the integrated headings lie apart, and from the reference where there is one."""
    figure = new_figure(2.7)
    axes = figure.add_subplot()
    step = max(1, len(driven.time_s) // MOST_POINTS)
    minutes = (driven.time_s[::step] - driven.time_s[0]) / 60.0
    if reference_deg is None:
        apart = (driven.raw_deg - driven.compensated_deg)[::step]
        axes.plot(minutes, apart, color=VERMILION, label="without less with compensation")
        axes.set_ylabel("difference of heading, deg")
    else:
        true = np.unwrap(reference_deg, period=360.0)
        for course, colour, name in (
            (driven.raw_deg, VERMILION, "without compensation"),
            (driven.compensated_deg, BLUE, "with compensation"),
        ):
            error = (course - course[0]) - (true - true[0])
            axes.plot(minutes, error[::step], color=colour, label=name)
        axes.set_ylabel("heading error, deg")
    axes.set_xlabel("time, min")
    axes.legend(loc="best")
    return figure
