"""Plots of records and results: time series, residuals, and all axes together."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from station.plots import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    INK,
    MIST,
    PALE,
    VERMILION,
    Axis,
    Item,
    Line,
    Note,
    Panel,
    Plot,
    Points,
    Region,
    Rule,
    Steps,
)
from station.results import ResultDocument

from .dataset import AXES, Array, Mask
from .fitted import FittedRecord, LineDetail

COLOUR = {"IA": BLUE, "NA": VERMILION, "LA": GREEN}
DASHES = {"IA": "-", "NA": "--", "LA": "-."}
ZOOM_PERIODS = 4.0
MEAN_PERIODS = 0.25
EDGE_SIGMA = 6.5

BEST = "best estimate with U (95 %)"
PUBLISHED = "published formula (has no sign)"
WITHIN = "within the limit"
LIMIT = "limit"
LEFT_OUT = "Samples left out of the fit are marked; arrows stand for those beyond the picture."


def time_series(record: FittedRecord, lines: Sequence[LineDetail]) -> Plot:
    """Return samples, their mean and the driving field: the whole record, and a few periods."""
    segment, gyro = record.segment, record.gyro
    time_s = segment.time_s - float(segment.time_s[0])
    period_s, end_s = 1.0 / lines[0].frequency_Hz, float(time_s[-1])
    # A whole number of samples: counted pulses would beat with anything else.
    interval_s = float(np.median(np.diff(time_s)))
    window_s = max(2, round(MEAN_PERIODS * period_s / interval_s)) * interval_s
    zoom_s = min(ZOOM_PERIODS * period_s, end_s)
    low, high = _limits_of_kept(record)
    several = len(record.axes) > 1
    source = "measured" if len(segment.field_time_s) else "fitted"
    panels = []
    for column, (until_s, size) in enumerate(((end_s, 1.3), (zoom_s, 2.6))):
        inside, x = time_s <= until_s, Axis(low=0.0, high=until_s)
        at_s, rate = time_s[inside], segment.rate_deg_per_h[inside]
        shown = np.linspace(0.0, until_s, 1200)
        smooth = running_mean(time_s, segment.rate_deg_per_h, gyro.kept, shown, window_s)
        samples: list[Item] = [Points(at_s, rate, marker=".", colour=GREY, size=size)]
        mean: list[Item] = [Line(shown, smooth, width=1.0)]
        left = "samples, deg/h", "their mean, deg/h", f"{source} field, mT"
        y = [Axis(left[0], low=low, high=high), Axis(left[1]), Axis(left[2])]
        if column:
            fit = gyro.model_deg_per_h[inside]
            mean = [
                Line(shown, smooth, width=1.0, label=f"mean over {window_s:.3g} s"),
                Line(at_s, fit, dashes="--", colour=BLACK, label="fit"),
            ]
            y = [Axis(low=low, high=high), Axis(room=0.25), Axis(room=0.3 * several)]
        field = _field(record, lines, until_s, labelled=several and column > 0)
        x_below = Axis("time in the record, s", low=0.0, high=until_s)
        title = f"Its first {zoom_s:.3g} s" if column else "The whole record"
        rows = ((samples, x, title, 1), (mean, x, "", 2), (field, x_below, "", 3))
        panels += [
            Panel(
                tuple(items),
                title=title,
                row=row,
                column=column,
                x=below,
                y=y[row],
                legend="upper right",
                legend_columns=columns,
            )
            for row, (items, below, title, columns) in enumerate(rows)
        ]
    return Plot(
        f"{joined(record.axes)} driven: the record",
        "Output of the gyro: single samples; their running mean, in which the response to "
        "the field shows where it is strong enough. Below, the driving field.",
        tuple(panels),
        5.4,
        widths=(2.5, 1),
        heights=(1, 1.25, 1),
        gap_x=0.05,
        gap_y=0.16,
        share_x="column",
        share_y="row",
    )


def _field(
    record: FittedRecord, lines: Sequence[LineDetail], until_s: float, *, labelled: bool
) -> list[Item]:
    """Return the measured field of the driven axes, the fitted one where none was given."""
    segment, start_s = record.segment, float(record.segment.time_s[0])
    field_s, field_mT = segment.field_time_s - start_s, segment.field_mT
    if not len(field_s):
        field_s = np.linspace(0.0, until_s, 4000)
        field_mT = fitted_field_mT(lines, field_s + start_s - segment.middle_s)
    inside = field_s <= until_s
    return [
        Line(
            field_s[inside],
            field_mT[inside, AXES.index(axis)],
            colour=COLOUR[axis],
            width=0.9,
            dashes=DASHES[axis] if len(record.axes) > 1 else "-",
            label=axis if labelled else "",
        )
        for axis in record.axes
    ]


def residuals(record: FittedRecord) -> Plot:
    """Return what the fit left against time, rejected samples marked, and its distribution.

    Where the output is counts the bins are as wide as a pulse. The segment must have been fitted
    (its residual sigma above zero).
    """
    gyro, quantum = record.gyro, record.segment.quantum_deg_per_h
    time_s = record.segment.time_s - float(record.segment.time_s[0])
    left, kept, sigma = gyro.residual_deg_per_h, gyro.kept, gyro.residual_sigma_deg_per_h
    edge = EDGE_SIGMA * sigma
    items: list[Item] = [Points(time_s[kept], left[kept], marker=".", size=1.6)]
    rejected = partial(Points, colour=VERMILION, size=6.0, beyond=True)
    out = ~kept & np.isfinite(left)
    for here, marker in ((np.abs(left) < edge, "x"), (left >= edge, "^"), (left <= -edge, "v")):
        if len(places := np.flatnonzero(out & here)):
            height = np.clip(left[places], -edge, edge)
            items.append(rejected(time_s[places], height, marker=marker))
    heights, edges = np.histogram(left[kept], bins=_bin_edges(left[kept], sigma, quantum))
    level = np.linspace(-5.0 * sigma, 5.0 * sigma, 200)
    normal = np.exp(-0.5 * (level / sigma) ** 2) / (np.sqrt(2.0 * np.pi) * sigma)
    normal *= heights.sum() * (edges[1] - edges[0])
    left_out = int((~kept).sum())
    lag = signed(gyro.lag_one_correlation)
    if quantum > 0.0:
        lag = f"{lag} (counting whole pulses makes it negative)"
    caption = (
        f"Residuals should be noise without a shape. Their lag-1 correlation is {lag}; the curve "
        "is a normal distribution of the same spread."
    )
    if left_out:
        caption = f"{caption} {LEFT_OUT}"
    return Plot(
        f"{joined(record.axes)} driven: what the fit leaves",
        caption,
        (
            Panel(
                (*items, Rule(y=0.0)),
                title=f"{int(kept.sum())} samples in the fit, {left_out} left out",
                x=Axis("time in the record, s", low=0.0, high=float(time_s[-1])),
                y=Axis("output − fit, deg/h", low=-edge, high=edge),
            ),
            Panel(
                (
                    Steps(edges, heights, colour=PALE, sideways=True),
                    Line(normal, level, colour=BLACK, width=1.0),
                ),
                title=f"σ = {sigma:.3g} deg/h",
                column=1,
                x=Axis("samples"),
            ),
        ),
        2.9,
        widths=(3.2, 1),
        gap_x=0.05,
        share_y="row",
    )


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


def fitted_field_mT(lines: Sequence[LineDetail], time_s: Array) -> Array:
    """Return the fitted field (n, 3) in mT on IA, NA, LA about the middle of its record."""
    field_mT = np.tile(np.asarray(lines[0].ambient_field_mT, dtype=np.float64), (len(time_s), 1))
    # Axes driven at one frequency share one line.
    for line in {line.frequency_Hz: line for line in lines}.values():
        turn = np.exp(2j * np.pi * line.frequency_Hz * time_s)
        field_mT += np.real(turn[:, None] * line.field.phasor_mT[None, :])
    return field_mT


def _limits_of_kept(record: FittedRecord) -> tuple[float | None, float | None]:
    """Return the scale of the samples of the fit: a wild one would hide all others."""
    good = record.segment.rate_deg_per_h[
        record.gyro.kept & np.isfinite(record.segment.rate_deg_per_h)
    ]
    if not len(good):
        return None, None
    low, high = float(good.min()), float(good.max())
    margin = 0.06 * (high - low) or 0.1
    return low - margin, high + margin


def summary(document: ResultDocument) -> Plot:
    """Return all axes' values with U, the published values beside them, and the limits behind."""
    results = document.results
    published = {entry.axis: entry.value for entry in document.published}
    limits = [result.limit.interval() for result in results if result.limit]
    spans = [abs(bound) for limit in limits for bound in limit if np.isfinite(bound)]
    spans += [
        abs(result.estimate.value) + (result.expanded_uncertainty or 0.0)
        for result in results
        if result.estimate.value is not None
    ]
    spans += [value for value in published.values() if value is not None]
    reach = 1.12 * max(spans, default=1.0) or 1.0
    behind, values = list[Item](), list[Item]()
    best = partial(Points, size=6.0, cap=4.0, bar_width=1.8, label=BEST)
    hollow = partial(Points, size=6.0, marker="D", fill="white", edge=1.5)
    diamond = partial(hollow, colour=VERMILION, label=PUBLISHED)
    for place, result in enumerate(results):
        if result.limit:
            height, bounds = (place - 0.38, place + 0.38), result.limit.interval()
            low, high = (float(bound) for bound in np.clip(bounds, -reach, reach))
            region = Region(x=(low, high), y=height, colour=MIST, opacity=1.0, label=WITHIN)
            ends = [bound for bound in bounds if np.isfinite(bound)]
            behind.append(region)
            behind += [Line([x] * 2, height, colour=INK, width=1.6, label=LIMIT) for x in ends]
        if (formula := published.get(result.estimate.axis)) is not None:
            values.append(diamond([formula], [place + 0.22]))
        if (value := result.estimate.value) is None:
            values.append(Note(0.0, place, "undetermined", slanted=True, boxed=True))
        else:
            bars = [result.expanded_uncertainty] if result.expanded_uncertainty else None
            values.append(best([value], [place - 0.1], bars_x=bars))
    return Plot(
        "Sensitivity of each axis",
        "Best estimates with their expanded uncertainty, against the limits where the "
        "plan sets any. The published formula takes a magnitude: it has no sign, and noise "
        "alone makes it larger than zero.",
        (
            Panel(
                (*behind, Rule(x=0.0, width=0.8), *values),
                x=Axis("magnetic sensitivity, deg/h/mT", low=-reach, high=reach),
                y=Axis(
                    low=len(results) - 0.5,
                    high=-0.5,
                    ticks=range(len(results)),
                    texts=tuple(result.estimate.axis or "" for result in results),
                    grid=False,
                ),
                legend="above",
                legend_columns=4,
            ),
        ),
        1.15 + 0.5 * len(results),
    )


def joined(axes: Sequence[str]) -> str:
    """Return names as a list in words."""
    return axes[0] if len(axes) == 1 else ", ".join(axes[:-1]) + " and " + axes[-1]


def signed(value: float) -> str:
    """Return a number with a minus sign as it is printed."""
    return f"{value:.3f}".replace("-", "−")
