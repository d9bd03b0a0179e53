"""Plots at the field's frequency and of the noise: spectrum, phase, Allan deviation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from procedures.estimation.sine import nearest_lines
from station.plots import (
    BLACK,
    GREY,
    INK,
    Arrow,
    Axis,
    Ellipse,
    Item,
    Line,
    Note,
    Panel,
    Plot,
    Points,
    Rule,
)

from .dataset import Array
from .fitted import FittedRecord, LineDetail
from .gyro import plotted_spectrum
from .plots import COLOUR, DASHES, joined

# The noise at a line is judged over so many cycles per record on each side of it.
FLOOR_REACH_CYCLES = 8.0
SPECTRUM_REACH = 5.0
PHASE_BINS = 12
WITHIN_95 = 2.448
"""Root of chi-square with two degrees of freedom at 95 %."""
MARKERS = "os^Dv<>"
ALLAN = (
    "Of the output without the fitted lines, drift included: the overlapping estimator (NIST "
    "SP 1065). The curve is σ²(τ) = 3 Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 with the "
    "coefficients of the table of the records, not below zero (IEEE Std 952, annex C): Q "
    "quantisation, N angle random walk, B bias instability, K rate random walk. A short record "
    "says nothing of those that act in long times."
)
BESIDE = (
    "Black bar: the amplitude that noise alone gives near f. Right: the same samples averaged over "
    "the phase of the field, drift and other lines taken off; 0 deg is where the field is largest. "
    "Below: the same spectrum as far as it goes, where hum and other devices would have lines."
)


def spectrum(record: FittedRecord, lines: Sequence[LineDetail], *, published: bool = True) -> Plot:
    """Return the published amplitude spectrum (S6) and the average over the field's phase.

    `published`: whether the published formula could read it.
    """
    several = len(lines) > 1
    peaks = "Circle: the peak that the published formula reads (S7)."
    if several:
        peaks = "Circles: the peaks that the published formula reads (S7)."
    if not published:
        peaks = (
            "The published formula cannot run on this record; its spectrum is drawn about the mean "
            "without the missing samples."
        )
    where = (
        "the lines at the fields’ frequencies" if several else "the line at the field’s frequency"
    )
    return Plot(
        f"{joined(record.axes)} driven: {where}",
        f"{peaks} {BESIDE}",
        (_spectrum_panel(record, lines), _folded_panel(record, lines), _whole_panel(record, lines)),
        6.2,
        widths=(2.1, 1),
        heights=(1.5, 1),
        gap_x=0.24,
        gap_y=0.42,
    )


def _spectrum_panel(record: FittedRecord, lines: Sequence[LineDetail]) -> Panel:
    frequency_Hz, amplitude = plotted_spectrum(record.segment)
    title, below, beside = "Amplitude spectrum", "frequency k/T, Hz", "y = 2|X[k]|/N, deg/h"
    if len(frequency_Hz) <= 2:
        note = Note(0.5, 0.5, "too few samples", inside=True)
        return Panel((note,), title=title, x=Axis(below, ticks=()), y=Axis(beside, ticks=()))
    step_Hz, interval_s = float(frequency_Hz[1]), record.segment.sample_interval_s
    # Of a record that is short against a period, one step is further than what is wanted.
    wanted_Hz = max(SPECTRUM_REACH * max(x.frequency_Hz for x in lines), step_Hz)
    highest_Hz = min(float(frequency_Hz[-1]), wanted_Hz)
    # The mean (k = 0) stands far above everything else and is not part of the picture.
    shown = slice(1, round(highest_Hz / step_Hz) + 1)
    positive = np.maximum(amplitude, 1e-12)
    marks, floors, peaks = list[Item](), list[Item](), list[Item]()
    for line in lines:
        first, several, colour = line is lines[0], len(lines) > 1, COLOUR[line.axis]
        f = record.segment.drive[line.axis].frequency_Hz
        named = "f, commanded" if several else f"f = {f:.6g} Hz, commanded"
        for x, label, width, dashes in ((f, named, 0.9, "--"), (2.0 * f, "2 f", 1.0, ":")):
            if x == f or x < highest_Hz:
                label = label if first else ""
                marks.append(Rule(x=x, colour=colour, width=width, dashes=dashes, label=label))
        floor = line.noise_floor_deg_per_h
        if floor is not None:
            reach = FLOOR_REACH_CYCLES * step_Hz
            label = "noise near f" if first else ""
            ends = [f - reach, f + reach], [floor, floor]
            floors.append(Line(*ends, colour=BLACK, width=2.2, label=label))
        near = nearest_lines(round(1.0 / step_Hz / interval_s), interval_s, f)
        if len(near):
            peak = near[int(np.argmax(amplitude[near.start : near.stop]))]
            at_Hz, who = frequency_Hz[peak], f" ({line.axis})" if several else ""
            text = f"peak{who}: y = {amplitude[peak]:.3g} deg/h at {at_Hz:.4g} Hz"
            circle = partial(Points, size=8.0, fill="none", edge=1.8)
            peaks.append(circle([at_Hz], [positive[peak]], colour=colour, label=text))
    low, high = _heights(positive[shown], lines)
    curve = Line(frequency_Hz[shown], positive[shown], colour=GREY, width=0.9)
    return Panel(
        (*marks, curve, *floors, *peaks),
        title=title,
        x=Axis(below, low=0.0, high=highest_Hz),
        y=Axis(beside, log=True, low=low, high=high),
        legend="upper right",
    )


def _whole_panel(record: FittedRecord, lines: Sequence[LineDetail]) -> Panel:
    """Return the spectrum up to k = N/2, where hum, dither and other devices have their lines."""
    frequency_Hz, amplitude = plotted_spectrum(record.segment)
    below, beside = "frequency k/T up to k = N/2, Hz", "y, deg/h"
    if len(frequency_Hz) <= 2:
        return Panel((), row=1, columns=2, x=Axis(below, ticks=()), y=Axis(beside, ticks=()))
    positive = np.maximum(amplitude[1:], 1e-12)
    marks = [
        Rule(x=record.segment.drive[line.axis].frequency_Hz, colour=COLOUR[line.axis], dashes="--")
        for line in lines
    ]
    return Panel(
        (*marks, Line(frequency_Hz[1:], positive, colour=GREY, width=0.7)),
        title="The whole spectrum",
        row=1,
        columns=2,
        x=Axis(below, low=0.0, high=float(frequency_Hz[-1])),
        y=Axis(beside, log=True),
    )


def _heights(shown: Array, lines: Sequence[LineDetail]) -> tuple[float, float]:
    """Return the limits of the spectrum, with room above the highest line for the legend."""
    typical = np.sort(shown)
    floors = [x.noise_floor_deg_per_h for x in lines if x.noise_floor_deg_per_h]
    low = min([float(typical[int(0.02 * (len(typical) - 1))]), *floors]) / 2.0
    high = max([float(typical[-1]), *floors])
    room = 0.12 + 0.075 * (len(lines) + 3)
    return low, high * (high / low) ** (room / (1.0 - room)) * 1.1


def _folded_panel(record: FittedRecord, lines: Sequence[LineDetail]) -> Panel:
    """Return the output less drift and other lines, averaged over the phase of each field."""
    title, below, beside = (
        "Averaged over the field’s phase",
        "phase of the field, deg",
        "output at f, deg/h",
    )
    segment, gyro, several = record.segment, record.gyro, len(lines) > 1
    items = list[Item]()
    for number, line in enumerate(lines):
        phasor = line.gyro_phasor_deg_per_h
        if phasor is None:
            continue
        turn = 2.0 * np.pi * line.frequency_Hz * (segment.time_s - segment.middle_s)
        alone = gyro.residual_deg_per_h + np.real(phasor * np.exp(1j * turn))
        field_phase = np.radians(line.field_phase_deg)
        turns = (turn[gyro.kept] + field_phase) / (2.0 * np.pi)
        mean, error = phase_average(turns, alone[gyro.kept])
        filled = np.isfinite(mean)
        centre = (np.arange(PHASE_BINS) + 0.5) * 360.0 / PHASE_BINS
        centre += 4.0 * (number - 0.5 * (len(lines) - 1))
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        fit = np.real(phasor * np.exp(1j * (angle - field_phase)))
        dashes, colour = DASHES[line.axis] if several else "-", COLOUR[line.axis]
        label, own = ("", line.axis) if several else ("fit", "mean ± s.e.")
        points = partial(Points, size=3.2, marker=MARKERS[number % 3], colour=colour)
        items += [
            Line(np.degrees(angle), fit, colour=colour, dashes=dashes, label=label),
            points(centre[filled], mean[filled], bars=error[filled], label=own),
        ]
    if not items:
        note = Note(0.5, 0.5, "not determined", inside=True)
        x, y = Axis(below, ticks=()), Axis(beside, ticks=())
        return Panel((note,), title=title, column=1, x=x, y=y)
    return Panel(
        (*items, Rule(y=0.0)),
        title=title,
        column=1,
        x=Axis(below, low=0.0, high=360.0, ticks=(0, 90, 180, 270, 360)),
        y=Axis(beside, room=0.22),
        legend="upper right",
        legend_columns=3,
    )


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


def phase_diagram(lines: Sequence[LineDetail]) -> Plot:
    """Return each line's response over field with the region where 95 % of such results would lie.

    Right is in phase with the field, up is a quarter period before it; both axes to one scale.
    """
    regions, arrows = list[Item](), list[Item]()
    reach = 0.0
    labelled: set[str] = set()
    for line in lines:
        if line.slope is None or line.slope_uncertainty is None:
            continue
        quadrature = line.quadrature or 0.0
        tall = WITHIN_95 * (line.quadrature_uncertainty or line.slope_uncertainty)
        wide = WITHIN_95 * line.slope_uncertainty
        colour = COLOUR[line.axis]
        name = f"{line.axis} at {line.frequency_Hz:.3g} Hz"
        label = "" if name in labelled else name
        labelled.add(name)
        regions.append(Ellipse(line.slope, quadrature, wide, tall, colour=colour))
        arrows += [
            Arrow(line.slope, quadrature, colour=colour),
            Points([line.slope], [quadrature], colour=colour, label=label),
        ]
        reach = max(reach, abs(line.slope) + wide, abs(quadrature) + tall)
    reach = 1.1 * reach or 1.0
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    circles = [
        Line(radius * np.cos(turn), radius * np.sin(turn), colour=INK, width=0.4, dashes=":")
        for radius in (0.5 * reach / 1.1, reach / 1.1)
    ]
    return Plot(
        "Response against field",
        "The response of each axis over its field, as a phasor: to the right what answers "
        "in phase with the field, upwards what comes before it. A sensitivity lies on the "
        "horizontal line; the circles are where 95 % of such measurements would lie. What "
        "other driven axes contribute is taken off.",
        (
            Panel(
                (*regions, *circles, Rule(y=0.0, width=0.8), Rule(x=0.0, width=0.8), *arrows),
                x=Axis("in phase with the field, deg/h/mT", low=-reach, high=reach),
                y=Axis("a quarter period before, deg/h/mT", low=-reach, high=reach),
                equal=True,
                legend="beside",
            ),
        ),
        3.9,
    )


def allan(records: Sequence[FittedRecord]) -> Plot:
    """Return deviation against averaging time, both logarithmic, with standard uncertainties."""
    items = list[Item]()
    for number, record in enumerate(records):
        deviation = record.allan
        if not len(deviation.tau_s):
            continue
        colour = COLOUR[record.axis] if record.axis else BLACK
        items.append(
            Points(
                deviation.tau_s,
                deviation.deviation,
                bars=np.minimum(deviation.standard_uncertainty, 0.9 * deviation.deviation),
                marker=MARKERS[number % len(MARKERS)],
                colour=colour,
                size=3.5,
                label=f"{joined(record.axes)} driven",
            )
        )
        if record.noise is not None:
            tau_s = np.geomspace(deviation.tau_s[0], deviation.tau_s[-1], 120)
            curve = record.noise.deviation_deg_per_h(tau_s)
            items.append(Line(tau_s, curve, colour=colour, width=1.0))
    x = Axis("averaging time τ, s", log=True)
    y = Axis("Allan deviation σ(τ), deg/h", log=True)
    panel = Panel(tuple(items), x=x, y=y, legend="upper right")
    return Plot("Allan deviation", ALLAN, (panel,), 3.6)
