"""What this procedure adds to the report: poses, records, rates, gain matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.common import homogeneity
from station.findings import Findings
from station.parts import Part, Table
from station.plots import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
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
)
from station.report.numbers import NOTHING, format_number, format_with_uncertainty
from station.results import ResultDocument

from .all_axes.spheres import spheres
from .all_axes.two_ways import Compared
from .calibration import Correction, correction_of
from .dataset import AXES, Array, NineAxisDataset
from .findings import NineAxisAnalysis, StaticSummary
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
        parts.append(_pose_check(analysis))
        parts.append(_static_records(analysis, dataset))
    if any(solution is not None for solution in analysis.axes.values()):
        parts.append(_rate_residuals(analysis))
    if np.isfinite(analysis.gain).any():
        parts.append(_gain(analysis))
    if analysis.others is not None:
        parts += spheres(analysis.others)
        if analysis.others.compared:
            parts.append(_two_ways(analysis.others.compared))
        coil = analysis.others.recorded.coil
        if coil is not None and coil.at_device is not None:
            parts.append(homogeneity.table(coil.at_device))
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


def _pose_check(analysis: NineAxisAnalysis) -> Plot:
    """Return what each position's accelerometers and gyros read less what they should."""
    static = analysis.static
    refused: list[Item] = [
        Region(x=(n - 0.4, n + 0.4), colour=VERMILION, opacity=0.12)
        for n, summary in enumerate(static)
        if not summary.pose.right
    ]
    left, right = refused.copy(), refused.copy()
    rows = [n for n, summary in enumerate(static) if summary.pose.right]
    for axis, name in enumerate(AXES):
        shift, colour = 0.16 * (axis - 1), COLOURS[axis]
        off = [
            MICRO * (summary.accelerometer[axis] - gravity_pattern(summary.position)[axis])
            for summary in static
        ]
        place = [n + shift for n in range(len(static))]
        left.append(Points(place, off, colour=colour, size=6.0, label=name))
        if analysis.bias is not None:
            place, residual = [n + shift for n in rows], analysis.bias.residual[:, axis]
            u = [2.0 * static[n].gyro_u[axis] for n in rows]
            right.append(Points(place, residual, bars=u, colour=colour, size=5.0, bar_width=0.9))
    zero = Rule(y=0.0, width=0.7)
    positions = Axis(
        low=-0.5,
        high=len(static) - 0.5,
        ticks=range(len(static)),
        texts=tuple(f"position {summary.position}" for summary in static),
    )
    return Plot(
        "Pose check",
        "Left: accelerometer means less gravity in the ideal position. Right: what the solution of "
        "all gyro means leaves. Red: a position that was refused.",
        (
            Panel(
                (*left, zero),
                title="accelerometers",
                x=positions,
                y=Axis("mean − expected, µg"),
                legend="above right",
                legend_columns=3,
            ),
            Panel(
                (*right, zero),
                title="gyros, bars 2 u",
                x=positions,
                y=Axis("mean − solution, deg/h"),
                column=1,
            ),
        ),
        2.9,
        gap_x=0.22,
    )


def _static_records(analysis: NineAxisAnalysis, dataset: NineAxisDataset) -> Plot:
    """Return each gyro's records, less their means, and its Allan deviation beside them."""
    positions = ", ".join(str(summary.position) for summary in analysis.static)
    panels: list[Panel] = []
    for axis, name in enumerate(AXES):
        first, last = axis == 0, axis == len(AXES) - 1
        panels += [
            Panel(
                _rates(analysis, dataset, axis),
                title=f"rate less its mean, positions {positions}" if first else "",
                x=Axis("time at rest, min" if last else ""),
                y=Axis(f"{name}, deg/h"),
                row=axis,
            ),
            Panel(
                _deviations(analysis, axis),
                title="Allan deviation, deg/h" if first else "",
                x=Axis("averaging time, s" if last else "", log=True),
                y=Axis(log=True, between=False),
                row=axis,
                column=1,
            ),
        ]
    return Plot(
        "Static records and Allan deviation",
        "Each gyro at rest, one position after the other. Where the Allan deviation no longer "
        "falls, a longer record does not make the bias better. N: angle random walk; B: bias "
        "instability where it is more than noise, both of all the longest records.",
        tuple(panels),
        5.8,
        widths=(1.35, 1.0),
        gap_x=0.2,
        gap_y=0.32,
        share_x="column",
    )


def _rates(analysis: NineAxisAnalysis, dataset: NineAxisDataset, axis: int) -> tuple[Item, ...]:
    items: list[Item] = []
    start = 0.0
    for record, summary in zip(dataset.static, analysis.static, strict=True):
        good = summary.kept[:, axis]
        time_s = record.time_s - record.time_s[0]
        minutes = _means((start + time_s[good]) / 60.0)
        rates = _means(record.rate_deg_per_h[good, axis] - summary.gyro[axis])
        items.append(Line(minutes, rates, colour=_colour(summary, axis), width=0.6))
        items.append(Rule(x=start / 60.0, colour=GREY))
        start += float(time_s[-1]) if len(time_s) else 0.0
    return tuple(items)


def _deviations(analysis: NineAxisAnalysis, axis: int) -> tuple[Item, ...]:
    items: list[Item] = [
        Points(
            deviation.tau_s,
            deviation.deviation,
            bars=deviation.standard_uncertainty,
            marker="",
            joined=1.0,
            colour=_colour(summary, axis),
            bar_width=0.6,
        )
        for summary in analysis.static
        if summary.allan and (deviation := summary.allan[axis]) is not None and len(deviation.tau_s)
    ]
    noise = analysis.noise[axis]
    if noise is not None:
        text = f"N = {noise.angle_random_walk_deg_per_sqrt_h:.3g} deg/√h"
        if noise.bias_instability_seen:
            text += f", B = {noise.bias_instability_deg_per_h:.2g} deg/h"
        items.append(Note(0.97, 0.92, text, inside=True, across="right", upright="top", size=8.0))
    return tuple(items)


def _colour(summary: StaticSummary, axis: int) -> str:
    return COLOURS[axis] if summary.pose.right else GREY


def _means(values: Array) -> Array:
    """Return means of equal stretches: the wander is to be seen, not the noise of a sample."""
    size = max(1, -(-len(values) // MAX_DOTS))
    means: Array = values[: len(values) // size * size].reshape(-1, size).mean(axis=1)
    return means


def _rate_residuals(analysis: NineAxisAnalysis) -> Plot:
    """Return how each rate's scale factor differs from K, axis by axis, with bars of 2 u."""
    solved = {axis: solution for axis, solution in analysis.axes.items() if solution is not None}
    panels = []
    for column, (axis, solution) in enumerate(solved.items()):
        reach = 2.0 * PPM * solution.scale_factor.standard_uncertainty
        reach /= abs(solution.scale_factor.value)
        rates = Points(
            solution.commanded,
            PPM * solution.deviation,
            bars=2.0 * PPM * solution.deviation_u,
            colour=COLOURS[axis],
            size=5.0,
            bar_width=1.0,
            cap=2.0,
        )
        kind = "weighted mean" if solution.agree else "plain mean"
        panels.append(
            Panel(
                (Region(y=(-reach, reach)), rates, Rule(y=0.0, width=0.7)),
                title=f"{AXES[axis]}: K is the {kind}",
                x=Axis("rate, deg/s", log=True),
                y=Axis("" if column else "K of the rate less K, ppm"),
                column=column,
            )
        )
    return Plot(
        "Scale factor rate by rate",
        "K of each rate, true rates from the encoder, less K; bars are 2 u, the band is 2 u of K. "
        "Rates that differ by noise alone are weighted, others count alike.",
        tuple(panels),
        3.0,
        gap_x=0.24,
    )


def _two_ways(compared: Sequence[Compared]) -> Table:
    """Return what turns and coil say of the magnetometer, side by side."""
    rows = []
    for own in compared:
        estimates = (own.of_turns.value, own.of_turns_u), (own.in_coil.value, own.in_coil_u)
        shown = [" ± ".join(format_with_uncertainty(v or 0.0, u)) for v, u in estimates]
        name = f"{own.of_turns.name.removeprefix('magnetometer_').replace('_', ' ')}"
        unit = "" if own.of_turns.unit == "1" else f", {own.of_turns.unit}"
        last = format_number(own.normalised_error, 2), "yes" if own.agrees else "no"
        away = " ± ".join(format_with_uncertainty(own.difference, own.u))
        rows.append([f"{name} {own.of_turns.axis}{unit}", *shown, away, *last])
    return Table(
        "Magnetometer by two ways",
        "By turns in the earth's field, and in the coil with the gaussmeter; standard "
        "uncertainties. E_n is the difference over twice its standard uncertainty; the ways "
        "agree unless chance gives a larger difference less than once in a thousand.",
        ["", "by turns", "in the coil", "difference", "E_n", "agree"],
        rows,
    )
