"""What this procedure adds to the report: poses, records, rates, gain matrix."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from station.findings import Findings
from station.parts import Part, Plot, Table
from station.report.drawing import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    VERMILION,
    label_above,
    new_figure,
)
from station.report.numbers import NOTHING, format_number, format_with_uncertainty
from station.results import ResultDocument

from .calibration import Correction, correction_of
from .dataset import AXES, Array, NineAxisDataset
from .findings import NineAxisAnalysis
from .pose import gravity_pattern

COLOURS = (BLUE, ORANGE, GREEN)
PPM = MICRO = 1e6
MAX_DOTS = 600
ARCMIN_PER_RAD = 60.0 * 180.0 / np.pi


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: how it stood, how it turned, and what corrects it."""
    analysis: NineAxisAnalysis = findings.detail.analysis
    dataset: NineAxisDataset = findings.detail.dataset
    parts: list[Part] = []
    if analysis.static:
        parts.append(_poses(analysis))
    if analysis.static:
        parts.append(
            Plot(
                "Pose check",
                "Left: accelerometer means less gravity in the ideal position. Right: what "
                "the solution of all gyro means leaves. Red: a position that was refused.",
                pose_check(analysis),
            )
        )
        parts.append(
            Plot(
                "Static records and Allan deviation",
                "Each gyro at rest, one position after the other. Where the Allan deviation "
                "no longer falls, a longer record does not make the bias better. N: angle "
                "random walk; B: bias instability where it is more than noise, both of all "
                "the longest records.",
                static_records(analysis, dataset),
            )
        )
    if any(solution is not None for solution in analysis.axes.values()):
        parts.append(
            Plot(
                "Scale factor rate by rate",
                "K of each rate, true rates from the encoder, less K; bars are 2 u, the band "
                "is 2 u of K. Rates that differ by noise alone are weighted, others count "
                "alike.",
                rate_residuals(analysis),
            )
        )
    if np.isfinite(analysis.gain).any():
        parts.append(_gain(analysis))
    correction = correction_of(analysis)
    if correction is not None:
        parts.append(_correction(correction))
    return tuple(parts)


def _poses(analysis: NineAxisAnalysis) -> Table:
    rows = []
    right = [n for n, summary in enumerate(analysis.static) if summary.pose.right]
    for n, summary in enumerate(analysis.static):
        heading = tilt = NOTHING
        if analysis.bias is not None and n in right:
            place = right.index(n)
            both = analysis.bias.heading_rad + analysis.bias.own_heading_rad[place]
            heading = f"{both * ARCMIN_PER_RAD:.2f}"
            tilt = f"{float(np.hypot(*analysis.bias.tilt_rad[place])) * ARCMIN_PER_RAD:.2f}"
        rows.append(
            [
                str(summary.position),
                "right" if summary.pose.right else summary.pose.why,
                *(
                    format_with_uncertainty(v, u)[0]
                    for v, u in zip(summary.gyro, summary.gyro_u, strict=True)
                ),
                heading,
                tilt,
            ]
        )
    note = "Gyro means at rest, and how each position stood by the solution."
    if analysis.bias is not None:
        value = analysis.bias.heading_rad * ARCMIN_PER_RAD
        u = analysis.bias.heading_u * ARCMIN_PER_RAD
        heading = f"{value:.1f}".replace("-", "−")
        note += f" Heading common to all: {heading} arcmin, u = {u:.1f} arcmin."
    columns = ["position", "pose", *(f"{axis}, deg/h" for axis in AXES)]
    return Table("Positions", note, [*columns, "heading, arcmin", "tilt, arcmin"], rows)


def _gain(analysis: NineAxisAnalysis) -> Table:
    rows = []
    for gyro, name in enumerate(AXES):
        row = [f"gyro {name}"]
        for axis in range(3):
            value, u = analysis.gain[gyro, axis], analysis.gain_u[gyro, axis]
            if not np.isfinite(value):
                row.append(NOTHING)
                continue
            row.append(" ± ".join(format_with_uncertainty(float(value), float(u))))
        rows.append(row)
    return Table(
        "Gain matrix",
        "Output of each gyro per true rate about each axis of the table, with its standard "
        "uncertainty. Off the diagonal it is the misalignment in rad, nearly.",
        ["", *(f"about {axis}" for axis in AXES)],
        rows,
    )


def _correction(correction: Correction) -> Table:
    rows = []
    for axis, name in enumerate(AXES):
        row = [name, format_number(float(correction.bias_deg_per_s[axis]), 7)]
        row.append(f"{PPM * correction.asymmetry[axis]:.2f}")
        row += [f"{value:.9f}" for value in correction.inverse[axis]]
        rows.append(row)
    return Table(
        "Correction",
        "True rate = inverse gain × (output − bias) / (1 + asymmetry/2 × its sign). Misalignments "
        "that were not measured and asymmetries that are noise count as zero. calibration.json "
        "beside this report holds the same, calibrate_gyros.c, .m and .py do it.",
        ["", "bias, deg/s", "asymmetry, ppm", *(f"inverse gain {axis}" for axis in AXES)],
        rows,
    )


def pose_check(analysis: NineAxisAnalysis) -> Figure:
    """Draw what each position's accelerometers and gyros read less what they should."""
    static = analysis.static
    figure = new_figure(2.9)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(wspace=0.22)
    place = np.arange(len(static))
    for axis, name in enumerate(AXES):
        shift = 0.16 * (axis - 1)
        off = [
            summary.accelerometer[axis] - gravity_pattern(summary.position)[axis]
            for summary in static
        ]
        left.plot(place + shift, np.array(off) * MICRO, "o", color=COLOURS[axis], label=name)
        if analysis.bias is None:
            continue
        rows = [n for n, summary in enumerate(static) if summary.pose.right]
        right.errorbar(
            np.array(rows) + shift,
            analysis.bias.residual[:, axis],
            yerr=[2.0 * static[n].gyro_u[axis] for n in rows],
            fmt="o",
            markersize=5,
            color=COLOURS[axis],
            elinewidth=0.9,
        )
    for n, summary in enumerate(static):
        if not summary.pose.right:
            for axes in (left, right):
                axes.axvspan(n - 0.4, n + 0.4, color=VERMILION, alpha=0.12)
    for axes in (left, right):
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set_xticks(place, [f"position {summary.position}" for summary in static])
        axes.set_xlim(-0.5, len(static) - 0.5)
    left.set_ylabel("mean − expected, µg")
    label_above(left, "accelerometers")
    left.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    right.set_ylabel("mean − solution, deg/h")
    label_above(right, "gyros, bars 2 u")
    return figure


def static_records(analysis: NineAxisAnalysis, dataset: NineAxisDataset) -> Figure:
    """Draw each gyro's records, less their means, and its Allan deviation beside them."""
    figure = new_figure(5.8)
    grid = figure.subplots(3, 2, squeeze=False, sharex="col", width_ratios=(1.35, 1))
    figure.subplots_adjust(hspace=0.32, wspace=0.2)
    for axis, name in enumerate(AXES):
        rates, allan = grid[axis]
        start = 0.0
        for record, summary in zip(dataset.static, analysis.static, strict=True):
            good = summary.kept[:, axis]
            time_s = record.time_s - record.time_s[0]
            minutes, values = _thinned(
                (start + time_s[good]) / 60.0,
                record.rate_deg_per_h[good, axis] - summary.gyro[axis],
            )
            colour = COLOURS[axis] if summary.pose.right else GREY
            rates.plot(minutes, values, color=colour, linewidth=0.6)
            rates.axvline(start / 60.0, color=GREY, linewidth=0.6)
            start += float(time_s[-1]) if len(time_s) else 0.0
            deviation = summary.allan[axis] if summary.allan else None
            if deviation is not None and len(deviation.tau_s):
                bars = deviation.standard_uncertainty
                allan.errorbar(
                    deviation.tau_s,
                    deviation.deviation,
                    yerr=bars,
                    color=colour,
                    linewidth=1.0,
                    elinewidth=0.6,
                )
        rates.set_ylabel(f"{name}, deg/h")
        _allan_axes(allan, analysis, axis)
    positions = ", ".join(str(summary.position) for summary in analysis.static)
    label_above(grid[0][0], f"rate less its mean, positions {positions}")
    label_above(grid[0][1], "Allan deviation, deg/h")
    grid[2][0].set_xlabel("time at rest, min")
    grid[2][1].set_xlabel("averaging time, s")
    return figure


def _allan_axes(axes: Axes, analysis: NineAxisAnalysis, axis: int) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.yaxis.set_minor_formatter(NullFormatter())
    noise = analysis.noise[axis]
    if noise is None:
        return
    text = f"N = {noise.angle_random_walk_deg_per_sqrt_h:.3g} deg/√h"
    if noise.bias_instability_seen:
        text += f", B = {noise.bias_instability_deg_per_h:.2g} deg/h"
    axes.text(0.97, 0.92, text, transform=axes.transAxes, ha="right", va="top", fontsize=8.0)


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """Return means of equal stretches, so that a plot has no more points than it can show."""
    size = -(-len(x) // MAX_DOTS)
    whole = len(x) - len(x) % size if size > 1 else len(x)
    if size <= 1 or whole == 0:
        return x, y
    return (
        x[:whole].reshape(-1, size).mean(axis=1),
        y[:whole].reshape(-1, size).mean(axis=1),
    )


def rate_residuals(analysis: NineAxisAnalysis) -> Figure:
    """Draw how each rate's scale factor differs from K, axis by axis, with bars of 2 u."""
    solved = {axis: solution for axis, solution in analysis.axes.items() if solution is not None}
    figure = new_figure(3.0)
    grid = figure.subplots(1, len(solved), squeeze=False)[0]
    figure.subplots_adjust(wspace=0.24)
    for axes, (axis, solution) in zip(grid, solved.items(), strict=True):
        axes.errorbar(
            solution.commanded,
            PPM * solution.deviation,
            yerr=2.0 * PPM * solution.deviation_u,
            fmt="o",
            markersize=5,
            color=COLOURS[axis],
            elinewidth=1.0,
            capsize=2,
        )
        u = PPM * solution.scale_factor.standard_uncertainty / abs(solution.scale_factor.value)
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.axhspan(-2.0 * u, 2.0 * u, color=GREY, alpha=0.25)
        axes.set_xscale("log")
        axes.set_xlabel("rate, deg/s")
        kind = "weighted mean" if solution.agree else "plain mean"
        label_above(axes, f"{AXES[axis]}: K is the {kind}")
    grid[0].set_ylabel("K of the rate less K, ppm")
    return figure
