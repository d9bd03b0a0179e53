"""Plots of an accelerometer's magnetic sensitivity: output, residuals, convergence, correlation."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from station.report.drawing import (
    BLUE,
    GREY,
    INK,
    VERMILION,
    label_above,
    label_outer,
    new_figure,
    panels,
)

from .dataset import AccelerometerAnalysis, AccelerometerDataset
from .model import COEFFICIENTS, FIELD_POWER, accelerations, model_columns

Array = NDArray[np.float64]

MICRO = 1e6
MILLI = 1e3
COLUMNS = 3
LIMIT_SIGMA = 5.0
CONVERGED_U = 10.0
ANGLES = "hsv"
"""Colours that end where they begin, as angles do."""


def output_by_field(dataset: AccelerometerDataset, analysis: AccelerometerAnalysis) -> Figure:
    """Draw, plane by plane, how the output moves with the field at each angle.

    From each row the part of the solution that knows no field is taken off: gravity's part is ten
    thousand times larger, and drift and temperature would part the passes of a plan. Dots are
    measured, lines the solution.
    """
    planes = list(dict.fromkeys(dataset.plane.tolist()))
    figure = new_figure(3.6)
    grid = figure.subplots(1, len(planes), sharey=True, squeeze=False)[0]
    figure.subplots_adjust(wspace=0.06, right=0.9)
    colours = mpl.colormaps[ANGLES]
    by_field = magnetic_part(dataset, analysis)
    for axes, plane in zip(grid, planes, strict=True):
        used = analysis.used & (dataset.plane == plane)
        angle_deg = np.round(np.mod(dataset.theta_commanded_deg, 360.0), 3)
        for angle in np.unique(angle_deg[used]):
            rows = np.flatnonzero(used & (angle_deg == angle))
            rows = rows[np.argsort(dataset.field_T[rows], kind="stable")]
            field_mT, line = dataset.field_T[rows] * MILLI, by_field[rows]
            colour = colours(angle / 360.0)
            axes.plot(field_mT, line * MICRO, color=colour, linewidth=0.9)
            measured = (line + analysis.residual_V[rows]) * MICRO
            axes.plot(field_mT, measured, ".", color=colour, markersize=4.5)
        axes.set_xlabel("field, mT")
        label_above(axes, f"plane {plane}")
    grid[0].set_ylabel("output by the field, µV")
    _angle_bar(figure)
    return figure


def magnetic_part(dataset: AccelerometerDataset, analysis: AccelerometerAnalysis) -> Array:
    """Return the part of the solution that the field makes, in V (rows,)."""
    acceleration_g = accelerations(dataset.plane, np.radians(dataset.theta_deg), dataset.gravity_g)
    columns = model_columns(acceleration_g, dataset.field_T)
    own = {
        estimate.name: estimate.value or 0.0
        for estimate in analysis.estimates
        if estimate.name in FIELD_POWER
    }
    return np.asarray(sum(own[name] * columns[:, COEFFICIENTS.index(name)] for name in own))


def _angle_bar(figure: Figure) -> None:
    """Draw what colour stands for what angle, a strip at the right."""
    strip = figure.add_axes((0.925, 0.2, 0.014, 0.66))
    strip.imshow(
        np.linspace(0.0, 1.0, 256)[:, None],
        aspect="auto",
        cmap=ANGLES,
        origin="lower",
        extent=(0.0, 1.0, 0.0, 360.0),
    )
    strip.set_xticks([])
    strip.set_yticks([0, 90, 180, 270, 360])
    strip.yaxis.tick_right()
    strip.grid(False)
    strip.set_title("deg", fontsize=8.0, pad=4)


def residual_map(dataset: AccelerometerDataset, analysis: AccelerometerAnalysis) -> Figure:
    """Draw the residuals over angle and field as colours, and against time below."""
    planes = list(dict.fromkeys(dataset.plane.tolist()))
    figure = new_figure(5.2)
    grid = figure.add_gridspec(
        2, len(planes), height_ratios=(1.2, 1), hspace=0.42, wspace=0.06, right=0.9
    )
    noise = float(analysis.noise_V or 1.0)
    reach = 3.0 * noise * MICRO
    judged = np.isfinite(analysis.residual_V)
    residual = analysis.residual_V * MICRO
    for column, plane in enumerate(planes):
        axes = figure.add_subplot(grid[0, column])
        angle_deg, field_mT, left = points_of(
            dataset, residual, analysis.used & (dataset.plane == plane)
        )
        picture = axes.scatter(
            angle_deg,
            field_mT,
            c=left,
            cmap="RdBu_r",
            vmin=-reach,
            vmax=reach,
            s=22,
            marker="s",
            edgecolors=GREY,
            linewidths=0.3,
        )
        axes.set_xlim(-10.0, 370.0)
        axes.set_xticks([0, 90, 180, 270, 360])
        axes.set_xlabel("angle, deg")
        label_above(axes, f"plane {plane}")
        if column:
            axes.tick_params(labelleft=False)
        else:
            axes.set_ylabel("field, mT")
    strip = figure.add_axes((0.925, 0.6, 0.014, 0.28))
    figure.colorbar(picture, cax=strip)
    strip.set_title("µV", fontsize=8.0, pad=4)
    below = figure.add_subplot(grid[1, :])
    minutes = dataset.time_s / 60.0
    below.plot(
        minutes[analysis.used], residual[analysis.used], ".", color=BLUE, markersize=3, zorder=3
    )
    edge = 1.1 * LIMIT_SIGMA * noise * MICRO
    out = judged & ~analysis.used
    for rows, marker in (
        (out & (residual >= 0), "^"),
        (out & (residual < 0), "v"),
    ):
        below.plot(
            minutes[rows],
            np.clip(residual[rows], -edge, edge),
            marker,
            color=VERMILION,
            markersize=6,
            clip_on=False,
            linestyle="none",
        )
    below.axhline(0.0, color=INK, linewidth=0.6)
    below.set_ylim(-edge, edge)
    below.set_xlabel("time, min")
    below.set_ylabel("output − fit, µV")
    label_above(
        below,
        f"{int(analysis.used.sum())} rows in the solution, σ = {noise * MICRO:.3g} µV; "
        f"{int(out.sum())} left out",
    )
    return figure


def points_of(
    dataset: AccelerometerDataset, residual: Array, rows: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Return angle (deg), field (mT) and mean residual of each point that the rows measured."""
    angle_deg = np.mod(np.round(dataset.theta_deg[rows], 1), 360.0)
    points = np.column_stack((angle_deg, dataset.field_commanded_T[rows]))
    points, number = np.unique(points, axis=0, return_inverse=True)
    count = np.bincount(number.ravel())
    field_mT = np.bincount(number.ravel(), weights=dataset.field_T[rows] * MILLI) / count
    return points[:, 0], field_mT, np.bincount(number.ravel(), weights=residual[rows]) / count


def convergence(analysis: AccelerometerAnalysis) -> Figure:
    """Draw each coefficient of the finite-memory solution, against the full-data one, in its u."""
    path = analysis.path
    assert path is not None
    own = {estimate.name: estimate for estimate in analysis.estimates}
    count = len(path.names)
    figure = new_figure(0.7 + 1.25 * -(-count // COLUMNS))
    grid = panels(figure, count, COLUMNS, share_x=True, share_y=False)
    label_outer(grid, COLUMNS, "rows", "in u")
    figure.subplots_adjust(hspace=0.5, wspace=0.24)
    place = np.arange(1, len(path.estimates) + 1)
    there = np.flatnonzero(np.isfinite(path.estimates).any(axis=1))
    first = max(float(there[0]) - 0.02 * len(place), 0.0) if len(there) else 0.0
    for number, (name, axes) in enumerate(zip(path.names, grid, strict=True)):
        value, u = own[name].value, own[name].standard_uncertainty
        if value is None or u is None or u <= 0.0:
            continue
        deviation = (path.estimates[:, number] - value) / u
        axes.plot(place, deviation, color=BLUE, linewidth=1.0)
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.axvline(path.window, color=VERMILION, linewidth=0.8, linestyle="--")
        last = deviation[np.isfinite(deviation)][-len(deviation) // 3 :]
        reach = max(CONVERGED_U, 1.3 * float(np.max(np.abs(last)))) if len(last) else CONVERGED_U
        axes.set_ylim(-reach, reach)
        axes.set_xlim(first, len(place))
        label_above(axes, name)
    return figure


def correlation(names: Sequence[str], covariance: Array) -> Figure:
    """Draw the correlation of the determined coefficients as numbers on colours."""
    deviations = np.sqrt(np.diag(covariance))
    scales = np.outer(deviations, deviations)
    matrix = np.divide(covariance, scales, out=np.zeros_like(covariance), where=scales > 0.0)
    figure = new_figure(0.9 + 0.3 * len(names))
    axes = figure.add_subplot()
    axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for row in range(len(names)):
        for column in range(len(names)):
            value = round(float(matrix[row, column]), 2) + 0.0
            axes.text(
                column,
                row,
                f"{value:.2f}".replace("-", "−"),
                ha="center",
                va="center",
                fontsize=7.5,
                color="white" if abs(value) > 0.65 else INK,
            )
    axes.set_xticks(range(len(names)), names)
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(length=0)
    axes.grid(False)
    return figure
