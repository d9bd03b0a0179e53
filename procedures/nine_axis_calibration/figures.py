"""What this procedure adds to the report: poses, records, rates, gain matrix."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from procedures.nine_axis_calibration import plots
from procedures.nine_axis_calibration.calibration import Correction, correction_of
from procedures.nine_axis_calibration.dataset import AXES, NineAxisDataset
from procedures.nine_axis_calibration.findings import NineAxisAnalysis
from station.findings import Findings
from station.report.drawing import STYLE
from station.report.numbers import NOTHING, format_number, format_with_uncertainty
from station.report.parts import Part, Plot, Table
from station.results import ResultDocument

ARCMIN_PER_RAD = 60.0 * 180.0 / np.pi
PPM = 1e6


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: how it stood, how it turned, and what corrects it."""
    analysis: NineAxisAnalysis = findings.detail.analysis
    dataset: NineAxisDataset = findings.detail.dataset
    parts: list[Part] = []
    if analysis.static:
        parts.append(_poses(analysis))
    with mpl.rc_context(STYLE):
        if analysis.static:
            parts.append(
                Plot(
                    "Pose check",
                    "Left: accelerometer means less gravity in the ideal position. Right: what "
                    "the solution of all gyro means leaves. Red: a position that was refused.",
                    plots.pose_check(analysis),
                )
            )
            parts.append(
                Plot(
                    "Static records and Allan deviation",
                    "Each gyro at rest, one position after the other. Where the Allan deviation "
                    "no longer falls, a longer record does not make the bias better. N: angle "
                    "random walk; B: bias instability where it is more than noise, both of all "
                    "the longest records.",
                    plots.static_records(analysis, dataset),
                )
            )
        if any(one is not None for one in analysis.axes.values()):
            parts.append(
                Plot(
                    "Scale factor rate by rate",
                    "K of each rate, true rates from the encoder, less K; bars are 2 u, the band "
                    "is 2 u of K. Rates that differ by noise alone are weighted, others count "
                    "alike.",
                    plots.rate_residuals(analysis),
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
    right = [n for n, one in enumerate(analysis.static) if one.pose.right]
    for n, one in enumerate(analysis.static):
        heading = tilt = NOTHING
        if analysis.bias is not None and n in right:
            place = right.index(n)
            both = analysis.bias.heading_rad + analysis.bias.own_heading_rad[place]
            heading = f"{both * ARCMIN_PER_RAD:.2f}"
            tilt = f"{float(np.hypot(*analysis.bias.tilt_rad[place])) * ARCMIN_PER_RAD:.2f}"
        rows.append(
            [
                str(one.position),
                "right" if one.pose.right else one.pose.why,
                *(
                    format_with_uncertainty(v, u)[0]
                    for v, u in zip(one.gyro, one.gyro_u, strict=True)
                ),
                heading,
                tilt,
            ]
        )
    said = "Gyro means at rest, and how each position stood by the solution."
    if analysis.bias is not None:
        value = analysis.bias.heading_rad * ARCMIN_PER_RAD
        u = analysis.bias.heading_u * ARCMIN_PER_RAD
        heading = f"{value:.1f}".replace("-", "−")
        said += f" Heading common to all: {heading} arcmin, u = {u:.1f} arcmin."
    columns = ["position", "pose", *(f"{axis}, deg/h" for axis in AXES)]
    return Table("Positions", said, [*columns, "heading, arcmin", "tilt, arcmin"], rows)


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
