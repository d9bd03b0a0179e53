"""What this procedure adds to the report: records, Allan deviation with the model, switch-ons."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from procedures.estimation.rate_spectrum import allan_terms
from station.findings import Findings
from station.parts import Part, Plot, Table
from station.report.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION, new_figure
from station.report.numbers import format_number
from station.results import ResultDocument

from .analysis import StaticAnalysis
from .axis import AxisAnalysis
from .dataset import StaticDataset

MAX_DOTS = 2000
PARTS = (("Q", BLUE), ("N", GREEN), ("B", ORANGE), ("K", PURPLE))


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return for each axis its Allan deviation, its records, and a table of switch-ons."""
    analysis: StaticAnalysis = findings.detail.analysis
    dataset: StaticDataset = findings.detail.dataset
    parts: list[Part] = []
    for analysed in analysis.axes:
        if analysed.fit is not None:
            parts += [
                Plot(
                    f"Allan deviation, {analysed.axis}",
                    "Points: overlapping Allan deviation of the longest records; bars are 2 u in "
                    "white noise, at a third of the record they are wide. Line: the fitted noise; "
                    "broken lines: its parts. The curve holds ramp and periodic lines, the model "
                    "does not.",
                    _allan(analysed),
                ),
                Plot(
                    f"Record at rest, {analysed.axis}",
                    "Means of neighbouring samples of the records that give the noise.",
                    _records(analysed, dataset.sample_interval_s),
                ),
            ]
        if len(analysed.means):
            parts.append(_switch_ons(analysed, dataset))
    return tuple(parts)


def _allan(analysed: AxisAnalysis) -> Figure:
    assert analysed.fit is not None and analysed.curve is not None
    figure = new_figure()
    axes = figure.add_subplot()
    tau, measured = analysed.curve.tau_s, analysed.curve.deviation
    # On a logarithmic scale a bar that reaches zero would have no end.
    reach = np.minimum(2.0 * analysed.curve.standard_uncertainty, 0.9 * measured)
    axes.errorbar(tau, measured, reach, fmt="o", color=GREY, markersize=3, label="measured")
    parts = analysed.fit.theta[:, None] * allan_terms(tau)
    axes.plot(tau, np.sqrt(parts.sum(axis=0)), color=VERMILION, label="fitted noise")
    floor = 0.2 * float(measured.min())
    for (name, colour), part in zip(PARTS, np.sqrt(parts), strict=True):
        if part.max() > floor:
            axes.plot(tau, part, "--", color=colour, linewidth=0.9, label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(bottom=floor)
    axes.set_xlabel("averaging time, s")
    axes.set_ylabel("Allan deviation, deg/h")
    axes.legend(loc="best")
    return figure


def _records(analysed: AxisAnalysis, interval_s: float) -> Figure:
    assert analysed.fit is not None
    figure = new_figure()
    axes = figure.add_subplot()
    for piece in analysed.fit.pieces:
        group = max(1, len(piece) // MAX_DOTS)
        whole = len(piece) // group * group
        mean = piece[:whole].reshape(-1, group).mean(axis=1)
        hours = (np.arange(len(mean)) + 0.5) * group * interval_s / 3600.0
        axes.plot(hours, mean, color=BLUE, linewidth=0.7)
    axes.set_xlabel("time in the record, h")
    axes.set_ylabel("rate, earth's rate in it, deg/h")
    return figure


def _switch_ons(analysed: AxisAnalysis, dataset: StaticDataset) -> Table:
    earth = dataset.directions[analysed.axis].earth_deg_per_h(dataset.latitude_rad)
    rows = [
        [str(number), f"{len(screened.there)}", format_number(float(mean) - earth)]
        for number, (screened, mean) in enumerate(
            zip(analysed.used, analysed.means, strict=True), 1
        )
    ]
    sentence = f"Mean of each switch-on, earth's rate of {earth:.4f} deg/h taken off."
    return Table(
        f"Switch-ons, {analysed.axis}", sentence, ["switch-on", "samples", "bias, deg/h"], rows
    )
