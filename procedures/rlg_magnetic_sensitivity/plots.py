"""Plots of records and results: time series, residuals, and all axes together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from station.report.drawing import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    INK,
    PALE,
    VERMILION,
    label_above,
    new_figure,
)
from station.results import ResultDocument

from .dataset import AXES, Array, LineDetail, Mask, Segment, SegmentDetail, middle_of

COLOUR = {"IA": BLUE, "NA": VERMILION, "LA": GREEN}
DASHES = {"IA": "-", "NA": "--", "LA": "-."}
ZOOM_PERIODS = 4.0
MEAN_PERIODS = 0.25
EDGE_SIGMA = 6.5

BEST = "best estimate with U (95 %)"
PUBLISHED = "published formula (has no sign)"
WITHIN = "within the limit"
LIMIT = "limit"
ORDER = (BEST, PUBLISHED, WITHIN, LIMIT)


def time_series(detail: SegmentDetail, lines: Sequence[LineDetail], segment: Segment) -> Figure:
    """Draw samples, their mean and the driving field: the whole record, and a few periods of it."""
    figure = new_figure(5.4)
    grid = figure.add_gridspec(
        3, 2, width_ratios=(2.5, 1), height_ratios=(1, 1.25, 1), wspace=0.05, hspace=0.16
    )
    wide = [figure.add_subplot(grid[row, 0]) for row in range(3)]
    close = [figure.add_subplot(grid[row, 1], sharey=wide[row]) for row in range(3)]
    time_s = detail.time_s - float(detail.time_s[0])
    end_s = float(time_s[-1])
    period_s = 1.0 / lines[0].frequency_Hz
    # A whole number of samples: counted pulses would beat with anything else.
    interval_s = float(np.median(np.diff(time_s)))
    window_s = max(2, round(MEAN_PERIODS * period_s / interval_s)) * interval_s
    zoom_s = min(ZOOM_PERIODS * period_s, end_s)
    for column, until_s, size in ((wide, end_s, 1.3), (close, zoom_s, 2.6)):
        inside = time_s <= until_s
        column[0].plot(
            time_s[inside], detail.rate_deg_per_h[inside], ".", color=GREY, markersize=size
        )
        shown = np.linspace(0.0, until_s, 1200)
        smooth = running_mean(time_s, detail.rate_deg_per_h, detail.kept, shown, window_s)
        column[1].plot(
            shown, smooth, color=BLUE, linewidth=1.0, label=f"mean over {window_s:.3g} s"
        )
        _field_panel(column[2], detail, lines, segment, until_s)
        for axes in column:
            axes.set_xlim(0.0, until_s)
        for axes in column[:2]:
            axes.tick_params(labelbottom=False)
        column[2].set_xlabel("time in the record, s")
    inside = time_s <= zoom_s
    close[1].plot(time_s[inside], detail.model_deg_per_h[inside], "--", color=BLACK, label="fit")
    _limit_to_kept(wide[0], detail)
    for axes in close:
        axes.tick_params(labelleft=False)
    _room_above(close[1], 0.25)
    legend_inside(close[1], ncols=2)
    if len(detail.axes) > 1:
        _room_above(close[2], 0.3)
        legend_inside(close[2], ncols=3)
    source = "measured" if len(segment.field_time_s) else "fitted"
    for axes, text in zip(
        wide, ("samples, deg/h", "their mean, deg/h", f"{source} field, mT"), strict=True
    ):
        axes.set_ylabel(text)
        axes.yaxis.set_label_coords(-0.085, 0.5)
    label_above(wide[0], "The whole record")
    label_above(close[0], f"Its first {zoom_s:.3g} s")
    return figure


def _field_panel(
    axes: Axes,
    detail: SegmentDetail,
    lines: Sequence[LineDetail],
    segment: Segment,
    until_s: float,
) -> None:
    """Draw the measured field of the driven axes, the fitted one where none was given."""
    start_s = float(detail.time_s[0])
    if len(segment.field_time_s):
        field_s, field_mT = segment.field_time_s - start_s, segment.field_mT
    else:
        field_s = np.linspace(0.0, until_s, 4000)
        field_mT = fitted_field_mT(detail, lines, field_s + start_s)
    inside = field_s <= until_s
    for axis in detail.axes:
        dashes = DASHES[axis] if len(detail.axes) > 1 else "-"
        values = field_mT[inside, AXES.index(axis)]
        axes.plot(field_s[inside], values, dashes, color=COLOUR[axis], linewidth=0.9, label=axis)


def residuals(detail: SegmentDetail, quantum: float = 0.0) -> Figure:
    """Draw what the fit left against time, rejected samples marked, and its distribution.

    `quantum` is one pulse in deg/h where the output is counts: the bins are then as wide as it.
    The segment must have been fitted (its residual sigma above zero).
    """
    figure = new_figure(2.9)
    grid = figure.add_gridspec(1, 2, width_ratios=(3.2, 1), wspace=0.05)
    axes = figure.add_subplot(grid[0, 0])
    side = figure.add_subplot(grid[0, 1], sharey=axes)
    time_s = detail.time_s - float(detail.time_s[0])
    left, kept = detail.residual_deg_per_h, detail.kept
    sigma = detail.residual_sigma_deg_per_h
    axes.set_xlabel("time in the record, s")
    axes.set_ylabel("output − fit, deg/h")
    edge = EDGE_SIGMA * sigma
    axes.plot(time_s[kept], left[kept], ".", color=BLUE, markersize=1.6)
    out = np.flatnonzero(~kept & np.isfinite(left))
    for places, marker in (
        (out[np.abs(left[out]) < edge], "x"),
        (out[left[out] >= edge], "^"),
        (out[left[out] <= -edge], "v"),
    ):
        if not len(places):
            continue
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

    heights, edges = np.histogram(left[kept], bins=_bin_edges(left[kept], sigma, quantum))
    side.stairs(heights, edges, orientation="horizontal", fill=True, color=PALE)
    level = np.linspace(-5.0 * sigma, 5.0 * sigma, 200)
    normal = np.exp(-0.5 * (level / sigma) ** 2) / (np.sqrt(2.0 * np.pi) * sigma)
    side.plot(normal * heights.sum() * (edges[1] - edges[0]), level, color=BLACK, linewidth=1.0)
    side.tick_params(labelleft=False)
    side.set_xlabel("samples")
    label_above(side, f"σ = {sigma:.3g} deg/h")
    return figure


def _bin_edges(values: Array, sigma: float, quantum: float) -> Array:
    """Return histogram edges over 5 sigma; counted pulses get a bin each, about their levels."""
    if quantum < 0.25 * sigma:
        return np.linspace(-5.0 * sigma, 5.0 * sigma, 41)
    level = float(np.angle(np.mean(np.exp(2j * np.pi * values / quantum)))) / (2.0 * np.pi)
    reach = int(np.ceil(5.0 * sigma / quantum))
    return np.asarray((level + np.arange(-reach, reach + 2) - 0.5) * quantum, dtype=np.float64)


def running_mean(time_s: Array, values: Array, kept: Mask, at_s: Array, window_s: float) -> Array:
    """Return the mean of the kept samples within a window about each time; NaN in gaps.

    A window that is not nearly full gives NaN: no line is drawn across a gap or beyond the ends.
    """
    good = kept & np.isfinite(values)
    time_s, values = time_s[good], values[good]
    if len(time_s) < 2:
        return np.full(len(at_s), np.nan)
    sums = np.concatenate(([0.0], np.cumsum(values - values[0])))
    first = np.searchsorted(time_s, at_s - 0.5 * window_s, side="left")
    last = np.searchsorted(time_s, at_s + 0.5 * window_s, side="right")
    count = last - first
    wanted = max(1.0, np.floor(0.8 * window_s / float(np.median(np.diff(time_s)))))
    mean = values[0] + (sums[last] - sums[first]) / np.maximum(count, 1)
    return np.where(count >= wanted, mean, np.nan)


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
        axes.set_ylim(low - margin, high + margin)


def _room_above(axes: Axes, part: float) -> None:
    """Make room for a legend above what is drawn."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + part * (high - low))


def legend_inside(axes: Axes, ncols: int) -> None:
    """Put the legend into the upper right corner of a panel."""
    axes.legend(
        loc="upper right", ncols=ncols, borderaxespad=0.2, handlelength=1.6, columnspacing=1.0
    )


def summary(document: ResultDocument) -> Figure:
    """Draw all axes' values with U, the published values beside them, and the limits behind."""
    results = document.results
    published = {entry.axis: entry.value for entry in document.published}
    limits = [result.limit.interval() if result.limit else None for result in results]
    figure = new_figure(1.15 + 0.5 * len(results))
    axes = figure.add_subplot()
    spans = [abs(bound) for limit in limits if limit for bound in limit if np.isfinite(bound)]
    spans += [
        abs(result.estimate.value) + (result.expanded_uncertainty or 0.0)
        for result in results
        if result.estimate.value is not None
    ]
    spans += [value for value in published.values() if value is not None]
    reach = 1.12 * max(spans, default=1.0) or 1.0
    labelled: set[str] = set()

    def once(text: str) -> str | None:
        new = text not in labelled
        labelled.add(text)
        return text if new else None

    for place, (result, limit) in enumerate(zip(results, limits, strict=True)):
        value, as_published = result.estimate.value, published.get(result.estimate.axis)
        if limit is not None:
            low, high = np.clip(limit, -reach, reach)
            axes.add_patch(
                Rectangle(
                    (low, place - 0.38),
                    high - low,
                    0.76,
                    facecolor="#E6F1F7",
                    edgecolor="none",
                    zorder=1,
                    label=once(WITHIN),
                )
            )
            for bound in limit:
                if np.isfinite(bound):
                    axes.plot(
                        [bound, bound],
                        [place - 0.38, place + 0.38],
                        color=INK,
                        linewidth=1.6,
                        zorder=2,
                        label=once(LIMIT),
                    )
        if value is None:
            axes.text(
                0.0,
                place,
                "undetermined",
                ha="center",
                va="center",
                style="italic",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 2.0},
            )
        else:
            axes.errorbar(
                value,
                place - 0.1,
                xerr=result.expanded_uncertainty or None,
                fmt="o",
                color=BLUE,
                markersize=6,
                capsize=4,
                elinewidth=1.8,
                zorder=4,
                label=once(BEST),
            )
        if as_published is not None:
            axes.plot(
                as_published,
                place + 0.22,
                "D",
                markersize=6,
                markerfacecolor="white",
                markeredgecolor=VERMILION,
                markeredgewidth=1.5,
                zorder=3,
                linestyle="none",
                label=once(PUBLISHED),
            )
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(len(results) - 0.5, -0.5)
    axes.set_yticks(range(len(results)), [result.estimate.axis or "" for result in results])
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    axes.set_xlabel("magnetic sensitivity, deg/h/mT")
    handles, names = axes.get_legend_handles_labels()
    order = sorted(range(len(names)), key=lambda i: ORDER.index(names[i]))
    axes.legend(
        [handles[i] for i in order],
        [names[i] for i in order],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=4,
        handlelength=1.6,
    )
    return figure
