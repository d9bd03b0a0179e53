"""What this procedure adds to the report: the record, the curve, what the fit leaves, a table."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from station.findings import Findings
from station.parts import Part, Plot, Table
from station.report.drawing import BLUE, GREY, VERMILION, new_figure
from station.report.numbers import format_with_uncertainty
from station.results import ResultDocument

from .analysis import AxisOverTemperature, TemperatureAnalysis
from .fit import BiasFit

HOUR_S = 3600.0
PLACES = 121
ROWS = 13
COVERAGE = 2.0


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return record, curve, residuals and compensation table of each axis with a solution."""
    analysis: TemperatureAnalysis = findings.detail.analysis
    parts: list[Part] = []
    for one_axis in analysis.axes:
        fit = one_axis.fit
        if fit is None:
            continue
        parts += [
            Plot(
                f"Bias over the record, {one_axis.axis}",
                "Output less the earth's rate, and the solution: curve, rate of temperature and "
                "hysteresis. Below, the temperature that the curve follows.",
                _record(one_axis, fit),
            ),
            Plot(
                f"Bias over temperature, {one_axis.axis}",
                "Points: output less the part of the rate of temperature; warming and cooling lie "
                "apart by the hysteresis. Line: the curve at rest in mid-loop, band 2 u.",
                _curve(one_axis, fit),
            ),
            Plot(
                f"Residuals over the record, {one_axis.axis}",
                "Output less the solution. Slow waves are the random walk and the bias "
                "instability, which the fitted noise holds; a shape that follows the temperature "
                "is not.",
                _residuals(one_axis, fit),
            ),
            _table(one_axis, fit),
        ]
    return tuple(parts)


def _hours(one_axis: AxisOverTemperature) -> np.ndarray:
    return np.asarray((one_axis.time_s - one_axis.time_s[0]) / HOUR_S)


def _record(one_axis: AxisOverTemperature, fit: BiasFit) -> Figure:
    figure = new_figure()
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(_hours(one_axis), one_axis.rate_deg_per_h, ".", color=GREY, markersize=1)
    above.plot(_hours(one_axis), fit.fitted, color=BLUE)
    above.set_ylabel("bias, deg/h")
    below.plot(_hours(one_axis), one_axis.setting.temperature, color=VERMILION)
    below.set_ylabel("temperature, degC")
    below.set_xlabel("time, h")
    return figure


def _curve(one_axis: AxisOverTemperature, fit: BiasFit) -> Figure:
    setting = one_axis.setting
    rate = setting.columns(fit.order, fit.value_of("lag")[0], 1.0)[:, fit.order]
    place = np.linspace(-1.0, 1.0, PLACES)
    low, high = setting.domain
    at = 0.5 * (low + high) + 0.5 * (high - low) * place
    values = np.array([fit.bias_at(float(x)) for x in place])
    figure = new_figure()
    axes = figure.add_subplot()
    free = one_axis.rate_deg_per_h - fit.value_of("s")[0] * rate
    axes.plot(setting.temperature, free, ".", color=GREY, markersize=1)
    axes.plot(at, values[:, 0], color=BLUE)
    edges = values[:, 0] - 2.0 * values[:, 1], values[:, 0] + 2.0 * values[:, 1]
    axes.fill_between(at, *edges, color=BLUE, alpha=0.2)
    axes.set_xlabel("temperature, degC")
    axes.set_ylabel("bias, deg/h")
    return figure


def _residuals(one_axis: AxisOverTemperature, fit: BiasFit) -> Figure:
    figure = new_figure()
    axes = figure.add_subplot()
    axes.plot(_hours(one_axis), fit.residual, ".", color=GREY, markersize=1)
    axes.axhline(0.0, linestyle="--", color=BLUE)
    axes.set_xlabel("time, h")
    axes.set_ylabel("residual, deg/h")
    return figure


def _table(one_axis: AxisOverTemperature, fit: BiasFit) -> Table:
    low, high = one_axis.setting.domain
    rows = []
    for place in np.linspace(-1.0, 1.0, ROWS):
        at = 0.5 * (low + high) + 0.5 * (high - low) * place
        value, u = fit.bias_at(float(place))
        rows.append([f"{at:.2f}", *format_with_uncertainty(value, COVERAGE * u)])
    return Table(
        f"Compensation, {one_axis.axis}",
        "Take the bias off the output at the gyro's own temperature, at rest. U is for 95 %.",
        ["temperature, degC", "bias, deg/h", "U, deg/h"],
        rows,
    )
