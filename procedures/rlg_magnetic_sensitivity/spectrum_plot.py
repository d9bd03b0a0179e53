"""Plots at the field's frequency and of the noise: spectrum, phase, Allan deviation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from station.report.drawing import BLACK, GREY, INK, label_above, new_figure

from .dataset import Array, LineDetail, Segment, SegmentDetail, middle_of
from .plots import COLOUR, DASHES, legend_inside

# The noise at a line is judged over so many cycles per record on each side of it.
FLOOR_REACH_CYCLES = 8.0
SPECTRUM_REACH = 5.0
PHASE_BINS = 12
WITHIN_95 = 2.448
"""Root of chi-square with two degrees of freedom at 95 %."""
MARKERS = "os^Dv<>"


def spectrum(detail: SegmentDetail, lines: Sequence[LineDetail], segment: Segment) -> Figure:
    """Draw the published amplitude spectrum (S6) and the average over the field's phase."""
    figure = new_figure(3.7)
    grid = figure.add_gridspec(1, 2, width_ratios=(2.1, 1), wspace=0.24)
    axes = figure.add_subplot(grid[0, 0])
    frequency_Hz, amplitude = detail.spectrum_frequency_Hz, detail.spectrum_deg_per_h
    if len(frequency_Hz) > 2:
        _spectrum_panel(axes, frequency_Hz, amplitude, lines, segment)
    else:
        axes.text(0.5, 0.5, "too few samples", ha="center", transform=axes.transAxes)
        axes.set_xticks([])
        axes.set_yticks([])
    axes.set_xlabel("frequency k/T, Hz")
    axes.set_ylabel("y = 2|X[k]|/N, deg/h")
    label_above(axes, "Amplitude spectrum")
    folded = figure.add_subplot(grid[0, 1])
    _folded_panel(folded, detail, lines)
    return figure


def _spectrum_panel(
    axes: Axes,
    frequency_Hz: Array,
    amplitude: Array,
    lines: Sequence[LineDetail],
    segment: Segment,
) -> None:
    step_Hz = float(frequency_Hz[1])
    # Of a record that is short against a period, one step is further than what is wanted.
    wanted_Hz = max(SPECTRUM_REACH * max(x.frequency_Hz for x in lines), step_Hz)
    highest_Hz = min(float(frequency_Hz[-1]), wanted_Hz)
    # The mean (k = 0) stands far above everything else and is not part of the picture.
    shown = slice(1, round(highest_Hz / step_Hz) + 1)
    positive = np.maximum(amplitude, 1e-12)
    axes.semilogy(frequency_Hz[shown], positive[shown], color=GREY, linewidth=0.9, zorder=3)
    several = len(lines) > 1
    for line in lines:
        colour = COLOUR[line.axis]
        commanded_Hz = segment.drive[line.axis].frequency_Hz
        who = f" ({line.axis})" if several else ""
        commanded = "f, commanded" if several else f"f = {commanded_Hz:.6g} Hz, commanded"
        axes.axvline(
            commanded_Hz,
            color=colour,
            linewidth=0.9,
            linestyle="--",
            zorder=1,
            label=commanded if line is lines[0] else "_",
        )
        if 2.0 * commanded_Hz < highest_Hz:
            axes.axvline(
                2.0 * commanded_Hz,
                color=colour,
                linewidth=1.0,
                linestyle=":",
                label="2 f" if line is lines[0] else "_",
            )
        if line.noise_floor_deg_per_h is not None:
            reach = FLOOR_REACH_CYCLES * step_Hz
            axes.hlines(
                line.noise_floor_deg_per_h,
                commanded_Hz - reach,
                commanded_Hz + reach,
                color=BLACK,
                linewidth=2.2,
                zorder=4,
                label="noise near f" if line is lines[0] else "_",
            )
        nearest = int(np.floor(commanded_Hz / step_Hz + 0.5))
        if 1 <= nearest < len(amplitude):
            first = max(nearest - 1, 1)
            peak = first + int(np.argmax(amplitude[first : nearest + 2]))
            axes.plot(
                frequency_Hz[peak],
                positive[peak],
                "o",
                markersize=8,
                markerfacecolor="none",
                markeredgecolor=colour,
                markeredgewidth=1.8,
                zorder=5,
                label=f"peak{who}: y = {amplitude[peak]:.3g} deg/h at {frequency_Hz[peak]:.4g} Hz",
            )
    typical = np.sort(positive[shown])
    low = float(typical[int(0.02 * (len(typical) - 1))])
    high = float(typical[-1])
    floors = [x.noise_floor_deg_per_h for x in lines if x.noise_floor_deg_per_h]
    low, high = min([low, *floors]) / 2.0, max([high, *floors])
    # Room above the highest line for the legend.
    room = 0.12 + 0.075 * (len(lines) + 3)
    axes.set_ylim(low, high * (high / low) ** (room / (1.0 - room)) * 1.1)
    axes.set_xlim(0.0, highest_Hz)
    axes.legend(loc="upper right", borderaxespad=0.2, handlelength=1.6)


def _folded_panel(axes: Axes, detail: SegmentDetail, lines: Sequence[LineDetail]) -> None:
    """Draw the output about its drift and all other lines, averaged over the phase of one field."""
    label_above(axes, "Averaged over the field’s phase")
    axes.set_xlabel("phase of the field, deg")
    axes.set_ylabel("output at f, deg/h")
    middle_s = middle_of(detail)
    drawn = False
    for number, line in enumerate(lines):
        phasor = line.gyro_phasor_deg_per_h
        if phasor is None:
            continue
        drawn = True
        turn = 2.0 * np.pi * line.frequency_Hz * (detail.time_s - middle_s)
        own = np.real(phasor * np.exp(1j * turn))
        left = (detail.residual_deg_per_h + own)[detail.kept]
        field_phase = np.radians(line.field_phase_deg)
        turns = (turn[detail.kept] + field_phase) / (2.0 * np.pi)
        mean, error = phase_average(turns, left)
        filled = np.isfinite(mean)
        centre = (np.arange(PHASE_BINS) + 0.5) * 360.0 / PHASE_BINS
        offset = 4.0 * (number - 0.5 * (len(lines) - 1))
        axes.errorbar(
            centre[filled] + offset,
            mean[filled],
            error[filled],
            fmt="os^"[number % 3],
            color=COLOUR[line.axis],
            markersize=3.2,
            elinewidth=0.8,
            label=line.axis if len(lines) > 1 else "mean ± s.e.",
        )
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        response = np.real(phasor * np.exp(1j * (angle - field_phase)))
        axes.plot(
            np.degrees(angle),
            response,
            color=COLOUR[line.axis],
            linestyle=DASHES[line.axis] if len(lines) > 1 else "-",
            label=None if len(lines) > 1 else "fit",
        )
    if not drawn:
        axes.text(0.5, 0.5, "not determined", ha="center", transform=axes.transAxes)
        axes.set_xticks([])
        axes.set_yticks([])
        return
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks([0, 90, 180, 270, 360])
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.22 * (high - low))
    legend_inside(axes, ncols=3)


def phase_average(turns: Array, values: Array) -> tuple[Array, Array]:
    """Return means over the bins of one turn and their standard errors; NaN in empty bins.

    The errors come from the scatter of whole turns: neighbouring samples may be correlated.
    """
    cycle = np.floor(turns).astype(np.int64)
    within = np.minimum(((turns - cycle) * PHASE_BINS).astype(np.int64), PHASE_BINS - 1)
    cell = (cycle - cycle.min()) * PHASE_BINS + within
    cells = int(cycle.max() - cycle.min() + 1) * PHASE_BINS
    count = np.bincount(cell, minlength=cells).reshape(-1, PHASE_BINS)
    total = np.bincount(cell, values, cells).reshape(-1, PHASE_BINS)
    per_turn = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    turns_seen = np.sum(count > 0, axis=0)
    mean = np.where(turns_seen > 0, np.nansum(per_turn, axis=0) / np.maximum(turns_seen, 1), np.nan)
    squares = np.nansum((per_turn - mean) ** 2, axis=0)
    enough = turns_seen > 1
    freedom = np.maximum(turns_seen - 1, 1)
    error = np.sqrt(squares / freedom / np.maximum(turns_seen, 1))
    return mean, np.where(enough, error, 0.0)


def phase_diagram(lines: Sequence[LineDetail]) -> Figure:
    """Draw each line's response over field with the region where 95 % of such results would lie.

    Right is in phase with the field, up is a quarter period before it; both axes to one scale.
    """
    figure = new_figure(3.9)
    axes = figure.add_subplot()
    reach = 0.0
    labelled: set[str] = set()
    for line in lines:
        if line.slope is None or line.slope_uncertainty is None:
            continue
        quadrature = line.quadrature or 0.0
        tall = line.quadrature_uncertainty or line.slope_uncertainty
        wide = line.slope_uncertainty
        colour = COLOUR[line.axis]
        axes.add_patch(
            Ellipse(
                (line.slope, quadrature),
                2.0 * WITHIN_95 * wide,
                2.0 * WITHIN_95 * tall,
                facecolor=colour,
                alpha=0.15,
                edgecolor="none",
            )
        )
        axes.annotate(
            "",
            (line.slope, quadrature),
            (0.0, 0.0),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6},
        )
        name = f"{line.axis} at {line.frequency_Hz:.3g} Hz"
        axes.plot(
            line.slope,
            quadrature,
            "o",
            color=colour,
            markersize=4,
            label=None if name in labelled else name,
        )
        labelled.add(name)
        reach = max(
            reach,
            abs(line.slope) + WITHIN_95 * wide,
            abs(quadrature) + WITHIN_95 * tall,
        )
    reach = 1.1 * reach or 1.0
    for share in (0.5, 1.0):
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        radius = share * reach / 1.1
        axes.plot(
            radius * np.cos(turn), radius * np.sin(turn), color=INK, linewidth=0.4, linestyle=":"
        )
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_aspect("equal")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("in phase with the field, deg/h/mT")
    axes.set_ylabel("a quarter period before, deg/h/mT")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure


def allan(segments: Sequence[SegmentDetail]) -> Figure:
    """Draw deviation against averaging time, both logarithmic, with standard uncertainties."""
    figure = new_figure(3.6)
    axes = figure.add_subplot()
    for number, detail in enumerate(segments):
        deviation = detail.allan
        if not len(deviation.tau_s):
            continue
        colour = COLOUR[detail.axes[0]] if len(detail.axes) == 1 else BLACK
        axes.errorbar(
            deviation.tau_s,
            deviation.deviation,
            np.minimum(deviation.standard_uncertainty, 0.9 * deviation.deviation),
            fmt=MARKERS[number % len(MARKERS)],
            color=colour,
            markersize=3.5,
            elinewidth=0.8,
            label=f"{joined(detail.axes)} driven",
        )
        if detail.noise is not None:
            tau_s = np.geomspace(deviation.tau_s[0], deviation.tau_s[-1], 120)
            axes.plot(tau_s, detail.noise.deviation_deg_per_h(tau_s), color=colour, linewidth=1.0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("averaging time τ, s")
    axes.set_ylabel("Allan deviation σ(τ), deg/h")
    axes.legend(loc="upper right")
    return figure


def joined(axes: Sequence[str]) -> str:
    """Return names as a list in words."""
    return axes[0] if len(axes) == 1 else ", ".join(axes[:-1]) + " and " + axes[-1]
