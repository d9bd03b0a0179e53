"""What this procedure adds to the report: response less its line, residuals of the records."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from station.findings import Findings
from station.parts import Part, Plot, Table
from station.report.drawing import BLUE, GREY, VERMILION, new_figure
from station.report.numbers import format_number
from station.results import ResultDocument

from .analysis import RateTableAnalysis
from .dataset import PPM
from .joint_fit import JointFit
from .results import Results


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the response's distance from its line, the scale factors, and the residuals."""
    analysis: RateTableAnalysis = findings.detail.analysis
    fit, results = analysis.fit, analysis.results
    if fit is None or results is None or results.scale_factor is None:
        return ()
    return (
        Plot(
            "Scale factor by rate",
            "K_i over K less one, both senses together; bars are 2 u. The broken line is K.",
            _factors(results),
        ),
        Plot(
            "Distance from the line",
            "Response without noise and bias less the line K, over the largest rate, in both "
            "senses.",
            _distances(results),
        ),
        Plot(
            "Residuals of the records",
            "Mean of each record less the joint solution, in the order of recording; bars are 2 u "
            "of its own noise.",
            _residuals(fit),
        ),
        _table(results),
    )


def _factors(results: Results) -> Figure:
    assert results.scale_factor is not None
    scale = results.scale_factor.value
    figure = new_figure()
    axes = figure.add_subplot()
    off = (results.factors / scale - 1.0) * PPM
    bars = 2.0 * results.factors_u / abs(scale) * PPM
    axes.errorbar(results.nominal, off, bars, fmt="o", color=BLUE, markersize=4)
    axes.axhline(0.0, linestyle="--", color=GREY)
    axes.set_xscale("log")
    axes.set_xlabel("rate, deg/s")
    axes.set_ylabel("K_i/K - 1, ppm")
    return figure


def _distances(results: Results) -> Figure:
    figure = new_figure()
    axes = figure.add_subplot()
    rates = np.concatenate((-results.nominal[::-1], results.nominal))
    distances = np.concatenate((results.curve[1][::-1], results.curve[0]))
    axes.plot(rates, distances, "o-", color=VERMILION, markersize=4)
    axes.axhline(0.0, linestyle="--", color=GREY)
    axes.set_xlabel("rate, deg/s")
    axes.set_ylabel("distance from the line, ppm of the largest rate")
    return figure


def _residuals(fit: JointFit) -> Figure:
    figure = new_figure()
    axes = figure.add_subplot()
    place = np.arange(1, len(fit.residual) + 1)
    axes.errorbar(place, fit.residual, 2.0 * fit.residual_u, fmt="o", color=BLUE, markersize=3)
    axes.axhline(0.0, linestyle="--", color=GREY)
    axes.set_xlabel("record")
    axes.set_ylabel("residual, deg/h")
    return figure


def _table(results: Results) -> Table:
    rows = [
        [f"{rate:g}", f"{factor:.8f}", format_number(float(u) * PPM, 2)]
        for rate, factor, u in zip(results.nominal, results.factors, results.factors_u, strict=True)
    ]
    return Table("Scale factors", "K_i of both senses.", ["rate, deg/s", "K_i", "u, ppm"], rows)
