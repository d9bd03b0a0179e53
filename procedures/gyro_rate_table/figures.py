"""What this procedure adds to the report: response less its line, residuals of the records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from station.findings import Findings
from station.parts import Part, Table
from station.plots import GREY, VERMILION, Axis, Panel, Plot, Points, Rule
from station.report.numbers import format_number
from station.results import ResultDocument

from .analysis import TriadAnalysis
from .dataset import PPM
from .solution import JointFit, Results

ZERO = Rule(y=0.0, colour=GREY, width=1.4, dashes="--")


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return of each axis the response's distance from its line, scale factors, residuals."""
    analysis: TriadAnalysis = findings.detail.analysis
    parts: list[Part] = []
    for axis, own in analysis.axes.items():
        if own.fit is None or own.results is None or own.results.scale_factor is None:
            continue
        drawn = (_factors(own.results), _distances(own.results), _residuals(own.fit))
        of = "" if axis == "IA" else f", {axis}"
        parts += [
            replace(part, title=f"{part.title}{of}") for part in (*drawn, _table(own.results))
        ]
    return tuple(parts)


def _factors(results: Results) -> Plot:
    assert results.scale_factor is not None
    scale = results.scale_factor.value
    off = (results.factors / scale - 1.0) * PPM
    bars = 2.0 * results.factors_u / abs(scale) * PPM
    return Plot(
        "Scale factor by rate",
        "K_i over K less one, both senses together; bars are 2 u. The broken line is K.",
        (
            Panel(
                (ZERO, Points(results.nominal, off, bars=bars, bar_width=1.4)),
                x=Axis("rate, deg/s", log=True),
                y=Axis("K_i/K - 1, ppm"),
            ),
        ),
    )


def _distances(results: Results) -> Plot:
    rates = np.concatenate((-results.nominal[::-1], results.nominal))
    distances = np.concatenate((results.curve[1][::-1], results.curve[0]))
    return Plot(
        "Distance from the line",
        "Response without noise and bias less the line K, over the largest rate, in both senses.",
        (
            Panel(
                (ZERO, Points(rates, distances, colour=VERMILION, joined=1.4)),
                x=Axis("rate, deg/s"),
                y=Axis("distance from the line, ppm of the largest rate"),
            ),
        ),
    )


def _residuals(fit: JointFit) -> Plot:
    place = np.arange(1, len(fit.residual) + 1)
    bars = 2.0 * fit.residual_u
    return Plot(
        "Residuals of the records",
        "Mean of each record less the joint solution, in the order of recording; bars are 2 u of "
        "its own noise.",
        (
            Panel(
                (ZERO, Points(place, fit.residual, bars=bars, bar_width=1.4, size=3.0)),
                x=Axis("record"),
                y=Axis("residual, deg/h"),
            ),
        ),
    )


def _table(results: Results) -> Table:
    rows = [
        [f"{rate:g}", f"{factor:.8f}", format_number(float(u) * PPM, 2)]
        for rate, factor, u in zip(results.nominal, results.factors, results.factors_u, strict=True)
    ]
    return Table("Scale factors", "K_i of both senses.", ["rate, deg/s", "K_i", "u, ppm"], rows)
