"""What this procedure adds to the report: records, Allan deviation with the model, switch-ons."""

from __future__ import annotations

import numpy as np

from procedures.estimation.rate_spectrum import allan_terms
from station.findings import Findings
from station.parts import Part, Table
from station.plots import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    Axis,
    Item,
    Line,
    Panel,
    Plot,
    Points,
)
from station.report.numbers import format_number
from station.results import ResultDocument

from .analysis import StaticAnalysis
from .checks import AxisAnalysis
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
            parts += [_allan(analysed), _records(analysed, dataset)]
        if len(analysed.means):
            parts.append(_switch_ons(analysed, dataset))
    return tuple(parts)


def _allan(analysed: AxisAnalysis) -> Plot:
    assert analysed.fit is not None and analysed.curve is not None
    tau, measured = analysed.curve.tau_s, analysed.curve.deviation
    # On a logarithmic scale a bar that reaches zero would have no end.
    reach = np.minimum(2.0 * analysed.curve.standard_uncertainty, 0.9 * measured)
    parts = analysed.fit.theta[:, None] * allan_terms(tau)
    floor = 0.2 * float(measured.min())
    items: list[Item] = [
        Line(tau, np.sqrt(parts.sum(axis=0)), colour=VERMILION, label="fitted noise")
    ]
    for (name, colour), part in zip(PARTS, np.sqrt(parts), strict=True):
        if part.max() > floor:
            items.append(Line(tau, part, colour=colour, width=0.9, dashes="--", label=name))
    items.append(
        Points(tau, measured, bars=reach, bar_width=1.4, colour=GREY, size=3.0, label="measured")
    )
    return Plot(
        f"Allan deviation, {analysed.axis}",
        "Points: overlapping Allan deviation of the longest records; bars are 2 u in white noise, "
        "at a third of the record they are wide. Line: the fitted noise; broken lines: its parts. "
        "The curve holds ramp and periodic lines, the model does not.",
        (
            Panel(
                tuple(items),
                x=Axis("averaging time, s", log=True),
                y=Axis("Allan deviation, deg/h", log=True, low=floor),
            ),
        ),
    )


def _records(analysed: AxisAnalysis, dataset: StaticDataset) -> Plot:
    assert analysed.fit is not None
    interval_s = dataset.sample_interval_s
    rate = "rate, earth's rate in it, deg/h" if dataset.earth_in_output else "rate, deg/h"
    lines = []
    for piece in analysed.fit.pieces:
        group = max(1, len(piece) // MAX_DOTS)
        whole = len(piece) // group * group
        mean = piece[:whole].reshape(-1, group).mean(axis=1)
        hours = (np.arange(0.5, len(mean)) * group) * (interval_s / 3600.0)
        lines.append(Line(hours, mean, width=0.7))
    return Plot(
        f"Record at rest, {analysed.axis}",
        "Means of neighbouring samples of the records that give the noise.",
        (
            Panel(
                tuple(lines),
                x=Axis("time in the record, h"),
                y=Axis(rate),
            ),
        ),
    )


def _switch_ons(analysed: AxisAnalysis, dataset: StaticDataset) -> Table:
    earth = dataset.earth_deg_per_h(analysed.axis)
    rows = [
        [str(number), f"{count}", format_number(float(mean) - earth)]
        for number, (count, mean) in enumerate(zip(analysed.counts, analysed.means, strict=True), 1)
    ]
    sentence = f"Mean of each switch-on, earth's rate of {earth:.4f} deg/h taken off."
    if not dataset.earth_in_output:
        sentence = "Mean of each switch-on; the navigator takes the earth's rate off itself."
    return Table(
        f"Switch-ons, {analysed.axis}", sentence, ["switch-on", "samples", "bias, deg/h"], rows
    )
