"""What this procedure adds to the report: output and residuals, what stage and mountings add."""

from __future__ import annotations

import numpy as np

from procedures.common.constants import ARCSEC_PER_RAD, FULL_TURN_DEG
from procedures.common.places import table_of
from station.findings import Findings
from station.parts import Part, Table
from station.plots import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    Axis,
    Panel,
    Plot,
    Points,
    Rule,
)
from station.report.numbers import format_number
from station.results import ResultDocument

from .analysis import TumbleAnalysis
from .dataset import TumbleDataset
from .model import Array
from .solution import Solution

MICRO, HOUR_S = 1e6, 3600.0
ZERO = Rule(y=0.0, colour=GREY, width=1.4, dashes="--")
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
MARKERS = ("o", "s", "^", "D")
ANGLE = Axis("angle of the stage, deg", ticks=(0, 90, 180, 270, 360))
HARMONICS = (
    "encoder, cosine of the angle",
    "encoder, sine of the angle",
    "encoder, cosine of twice the angle",
    "encoder, sine of twice the angle",
)


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return output and residuals by angle and by time, and the angles of stage and mountings."""
    analysis: TumbleAnalysis = findings.detail.analysis
    used, solution = analysis.used, analysis.solution
    if solution is None:
        return ()
    parts = (_by_angle(used, solution), _by_time(used, solution), _angles(used, solution))
    return (*parts, *table_of(findings.detail.dataset.places))


def named(dataset: TumbleDataset) -> list[str]:
    """Return what each mounting is called, in the order of time."""
    names = []
    for number in range(int(dataset.mounting[-1]) + 1):
        row = int(np.argmax(dataset.mounting == number))
        turned = "-reversed" if dataset.reverse[row] < 0.0 else ""
        head = f"{np.rad2deg(dataset.head_rad[row]):.0f}"
        names.append(f"{dataset.plane[row]}{turned}" + (f" head {head}" if head != "0" else ""))
    return names


def _points(x: Array, y: Array, dataset: TumbleDataset) -> tuple[Points, ...]:
    """Return the readings of each mounting in a colour and with a marker of its own."""
    return tuple(
        Points(
            x[dataset.mounting == number],
            y[dataset.mounting == number],
            colour=COLOURS[number % len(COLOURS)],
            marker=MARKERS[number // len(COLOURS) % len(MARKERS)],
            size=3.0,
            label=name,
        )
        for number, name in enumerate(named(dataset))
    )


def _by_angle(dataset: TumbleDataset, solution: Solution) -> Plot:
    angle = np.rad2deg(dataset.commanded_rad) % FULL_TURN_DEG
    residual = _points(angle, MICRO * solution.residual_V, dataset)
    return Plot(
        "Output and residuals by angle",
        "Output of each mounting, and below what the solution leaves of it. A course that all "
        "mountings share is one of the encoder, or a shape that the model does not have.",
        (
            Panel(
                _points(angle, dataset.output_V, dataset),
                y=Axis("output, V"),
                legend="upper right",
                legend_columns=2,
            ),
            Panel((ZERO, *residual), row=1, x=ANGLE, y=Axis("residual, µV"), legend=""),
        ),
        5.0,
        share_x="column",
    )


def _by_time(dataset: TumbleDataset, solution: Solution) -> Plot:
    hours = (dataset.time_s - dataset.time_s[0]) / HOUR_S
    slow = Points(hours, MICRO * solution.slow_V, colour=GREY, marker=".", size=3.0)
    residual = _points(hours, MICRO * solution.residual_V, dataset)
    return Plot(
        "Residuals and drift over time",
        "What the solution leaves, in the colours of the mountings above, and below what it takes "
        "for drift and temperature.",
        (
            Panel((ZERO, *residual), y=Axis("residual, µV"), legend=""),
            Panel((ZERO, slow), row=1, x=Axis("time, h"), y=Axis("drift, µV")),
        ),
        5.0,
        share_x="column",
    )


def _angles(dataset: TumbleDataset, solution: Solution) -> Table:
    priors = solution.priors
    names = [*HARMONICS[: int(priors.encoder.sum())]]
    names += [f"mounting {name}" for name in named(dataset)][: int((~priors.encoder).sum())]
    stated, solved = priors.prior_rad * ARCSEC_PER_RAD, solution.beside * ARCSEC_PER_RAD
    rows = [
        [name, f"{angle:+.2f}", format_number(float(prior), 3)]
        for name, angle, prior in zip(names, solved, stated, strict=True)
    ]
    return Table(
        "Angles of encoder and mountings",
        "Solved beside the coefficients, each with the standard uncertainty that is stated of it.",
        ["angle", "solved, arcsec", "stated, arcsec"],
        rows,
    )
