"""Plots of one record: output and field against time, and what the fit left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from procedures.rlg_magnetic_sensitivity.dataset import AXES, Segment
from procedures.rlg_magnetic_sensitivity.findings import LineDetail, SegmentDetail
from station.report.drawing import (
    BLACK,
    BLUE,
    GREEN,
    INK,
    PALE,
    VERMILION,
    label_above,
    new_figure,
)

Array = NDArray[np.float64]

COLOUR = {"IA": BLUE, "NA": VERMILION, "LA": GREEN}
DASHES = {"IA": "-", "NA": "--", "LA": "-."}
ZOOM_PERIODS = 4.0
EDGE_SIGMA = 6.5


def time_series(
    detail: SegmentDetail, lines: Sequence[LineDetail], segment: Segment | None
) -> Figure:
    """Draw output and driving field against time: the whole record, and a few periods of it."""
    figure = new_figure(8.8, 4.5)
    grid = figure.add_gridspec(
        2, 2, width_ratios=(2.5, 1), height_ratios=(1.5, 1), wspace=0.06, hspace=0.12
    )
    rate_axes = figure.add_subplot(grid[0, 0])
    rate_zoom = figure.add_subplot(grid[0, 1], sharey=rate_axes)
    field_axes = figure.add_subplot(grid[1, 0], sharex=rate_axes)
    field_zoom = figure.add_subplot(grid[1, 1], sharex=rate_zoom, sharey=field_axes)

    start_s = float(detail.time_s[0])
    time_s = detail.time_s - start_s
    period_s = 1.0 / lines[0].frequency_Hz
    window_s = period_s / 4.0
    for axes in (rate_axes, rate_zoom):
        axes.plot(time_s, detail.rate_deg_per_h, ".", color=PALE, markersize=1.6, label="samples")
    shown = np.linspace(0.0, time_s[-1], 1200)
    smooth = running_mean(time_s, detail.rate_deg_per_h, detail.kept, shown, window_s)
    rate_axes.plot(shown, smooth, color=BLUE, linewidth=1.0)
    _limit_to_kept(rate_axes, detail)

    zoom_s = min(ZOOM_PERIODS * period_s, time_s[-1])
    near = np.linspace(0.0, zoom_s, 400)
    smooth = running_mean(time_s, detail.rate_deg_per_h, detail.kept, near, window_s)
    rate_zoom.plot(near, smooth, color=BLUE, label=f"mean over {window_s:.3g} s")
    inside = time_s <= zoom_s
    rate_zoom.plot(time_s[inside], detail.model_deg_per_h[inside], "--", color=BLACK, label="fit")
    rate_zoom.set_xlim(0.0, zoom_s)
    rate_axes.set_xlim(0.0, time_s[-1])

    measured = segment is not None and len(segment.field_time_s) > 0
    for axis in detail.axes:
        place = AXES.index(axis)
        colour, dashes = COLOUR[axis], DASHES[axis]
        if segment is not None and measured:
            field_s, field_mT = segment.field_time_s - start_s, segment.field_mT[:, place]
        else:
            field_s = np.linspace(0.0, time_s[-1], 4000)
            field_mT = fitted_field_mT(detail, lines, field_s + start_s)[:, place]
        field_axes.plot(field_s, field_mT, dashes, color=colour, linewidth=0.8)
        close = field_s <= zoom_s
        field_zoom.plot(field_s[close], field_mT[close], dashes, color=colour, label=axis)

    rate_axes.set_ylabel("gyro output, deg/h")
    field_axes.set_ylabel(f"field, mT ({'measured' if measured else 'fitted'})")
    label_above(rate_axes, "The whole record")
    label_above(rate_zoom, f"Its first {zoom_s:.3g} s")
    for axes in (rate_axes, rate_zoom):
        axes.tick_params(labelbottom=False)
    for axes in (rate_zoom, field_zoom):
        axes.tick_params(labelleft=False)
    for axes in (field_axes, field_zoom):
        axes.set_xlabel("time in the record, s")
    legend_inside(rate_zoom, ncols=1)
    if len(detail.axes) > 1:
        low, high = field_axes.get_ylim()
        field_axes.set_ylim(low, high + 0.3 * (high - low))
        legend_inside(field_zoom, ncols=3)
    return figure


def residuals(detail: SegmentDetail) -> Figure:
    """Draw what the fit left against time, rejected samples marked, and its distribution."""
    figure = new_figure(8.8, 2.9)
    grid = figure.add_gridspec(1, 2, width_ratios=(3.2, 1), wspace=0.06)
    axes = figure.add_subplot(grid[0, 0])
    side = figure.add_subplot(grid[0, 1], sharey=axes)
    time_s = detail.time_s - float(detail.time_s[0])
    left, kept = detail.residual_deg_per_h, detail.kept
    sigma = detail.residual_sigma_deg_per_h
    axes.set_xlabel("time in the record, s")
    axes.set_ylabel("output − fit, deg/h")
    if not np.isfinite(sigma) or sigma <= 0.0:
        axes.text(0.5, 0.5, "no fit", ha="center", transform=axes.transAxes)
        side.set_axis_off()
        return figure
    edge = EDGE_SIGMA * sigma
    axes.plot(time_s[kept], left[kept], ".", color=BLUE, markersize=1.6)
    out = np.flatnonzero(~kept & np.isfinite(left))
    for places, marker in (
        (out[np.abs(left[out]) < edge], "x"),
        (out[left[out] >= edge], "^"),
        (out[left[out] <= -edge], "v"),
    ):
        axes.plot(
            time_s[places],
            np.clip(left[places], -edge, edge),
            marker,
            linestyle="none",
            color=VERMILION,
            markersize=6,
            clip_on=False,
            zorder=5,
        )
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_xlim(0.0, time_s[-1])
    axes.set_ylim(-edge, edge)
    label_above(axes, f"{int(kept.sum())} samples in the fit, {int((~kept).sum())} left out")

    heights, edges = np.histogram(left[kept], bins=40, range=(-5.0 * sigma, 5.0 * sigma))
    side.stairs(heights, edges, orientation="horizontal", fill=True, color=PALE)
    level = np.linspace(-5.0 * sigma, 5.0 * sigma, 200)
    normal = np.exp(-0.5 * (level / sigma) ** 2) / (np.sqrt(2.0 * np.pi) * sigma)
    side.plot(normal * heights.sum() * (edges[1] - edges[0]), level, color=BLACK, linewidth=1.0)
    side.tick_params(labelleft=False)
    side.set_xlabel("samples")
    label_above(side, f"σ = {sigma:.3g} deg/h")
    return figure


def running_mean(
    time_s: Array, values: Array, kept: NDArray[np.bool_], at_s: Array, window_s: float
) -> Array:
    """Return the mean of the kept samples within a window about each time; NaN in gaps.

    A window less than half filled gives NaN, so that no line is drawn across a gap.
    """
    good = kept & np.isfinite(values)
    time_s, values = time_s[good], values[good]
    if len(time_s) < 2:
        return np.full(len(at_s), np.nan)
    sums = np.concatenate(([0.0], np.cumsum(values - values[0])))
    first = np.searchsorted(time_s, at_s - 0.5 * window_s, side="left")
    last = np.searchsorted(time_s, at_s + 0.5 * window_s, side="right")
    count = last - first
    wanted = max(1.0, 0.4 * window_s / float(np.median(np.diff(time_s))))
    mean = values[0] + (sums[last] - sums[first]) / np.maximum(count, 1)
    return np.where(count >= wanted, mean, np.nan)


def middle_of(detail: SegmentDetail) -> float:
    """Return the middle of the segment in s, where its phasors have their phase."""
    finite = np.isfinite(detail.time_s) & np.isfinite(detail.rate_deg_per_h)
    time_s = detail.time_s[finite]
    return 0.5 * float(time_s[0] + time_s[-1]) if len(time_s) else 0.0


def fitted_field_mT(detail: SegmentDetail, lines: Sequence[LineDetail], time_s: Array) -> Array:
    """Return the fitted field (n, 3) in mT on IA, NA, LA: ambient field and driven lines."""
    field_mT = np.tile(np.asarray(lines[0].ambient_field_mT, dtype=np.float64), (len(time_s), 1))
    # Axes driven at one frequency share one line.
    for line in {line.frequency_Hz: line for line in lines}.values():
        turn = np.exp(2j * np.pi * line.frequency_Hz * (time_s - middle_of(detail)))
        field_mT += np.real(turn[:, None] * line.field_phasors_mT[None, :])
    return field_mT


def _limit_to_kept(axes: Axes, detail: SegmentDetail) -> None:
    """Scale to the samples of the fit: a wild one would hide all others."""
    good = detail.rate_deg_per_h[detail.kept & np.isfinite(detail.rate_deg_per_h)]
    if len(good):
        low, high = float(good.min()), float(good.max())
        margin = 0.06 * (high - low) or 0.1
        # Room for the legend above the samples.
        axes.set_ylim(low - margin, high + 6.0 * margin)


def legend_inside(axes: Axes, ncols: int) -> None:
    """Put the legend into the upper right corner of a panel."""
    axes.legend(
        loc="upper right", ncols=ncols, borderaxespad=0.2, handlelength=1.6, columnspacing=1.0
    )
