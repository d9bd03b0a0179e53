"""What this procedure adds to the report: the record, the curve, what the fit leaves, a table."""

from __future__ import annotations

import numpy as np

from procedures.common.places import table_of
from station.findings import Findings
from station.parts import Part, Table
from station.plots import BLUE, GREY, VERMILION, Axis, Band, Line, Panel, Plot, Points, Rule
from station.report.numbers import format_with_uncertainty
from station.results import ResultDocument

from .analysis import AxisOverTemperature, TemperatureAnalysis
from .solution import BiasFit

HOUR_S = 3600.0
PLACES = 121
ROWS = 13
COVERAGE = 2.0


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return record, curve, residuals and compensation table of each axis with a solution.

    After them come the temperatures at the places of a thermometer that has some.
    """
    analysis: TemperatureAnalysis = findings.detail.analysis
    parts: list[Part] = []
    for one_axis in analysis.axes:
        fit = one_axis.fit
        if fit is None:
            continue
        parts += [
            _record(one_axis, fit),
            _curve(one_axis, fit),
            _residuals(one_axis, fit),
            _table(one_axis, fit),
        ]
    return (*parts, *table_of(findings.detail.dataset.places))


def _hours(one_axis: AxisOverTemperature) -> np.ndarray:
    return np.asarray((one_axis.time_s - one_axis.time_s[0]) / HOUR_S)


def _samples(x: np.ndarray, y: np.ndarray) -> Points:
    return Points(x, y, marker=".", colour=GREY, size=1.0)


def _record(one_axis: AxisOverTemperature, fit: BiasFit) -> Plot:
    hours = _hours(one_axis)
    return Plot(
        f"Bias over the record, {one_axis.axis}",
        "Output less the earth's rate, and the solution: curve, rate of temperature and "
        "hysteresis. Below, the temperature that the curve follows.",
        (
            Panel(
                (_samples(hours, one_axis.rate_deg_per_h), Line(hours, fit.fitted)),
                y=Axis("bias, deg/h"),
            ),
            Panel(
                (Line(hours, one_axis.setting.temperature, colour=VERMILION),),
                row=1,
                x=Axis("time, h"),
                y=Axis("temperature, degC"),
            ),
        ),
        share_x="column",
    )


def _curve(one_axis: AxisOverTemperature, fit: BiasFit) -> Plot:
    setting = one_axis.setting
    rate = setting.columns(fit.order, fit.lags_s, 1.0)[:, fit.order]
    place = np.linspace(-1.0, 1.0, PLACES)
    low, high = setting.domain
    at = 0.5 * (low + high) + 0.5 * (high - low) * place
    bias, u = np.array([fit.bias_at(float(x)) for x in place]).T
    free = one_axis.rate_deg_per_h - fit.value_of("s")[0] * rate
    return Plot(
        f"Bias over temperature, {one_axis.axis}",
        "Points: output less the part of the rate of temperature; warming and cooling lie apart by "
        "the hysteresis. Line: the curve at rest in mid-loop, band 2 u.",
        (
            Panel(
                (
                    Band(at, bias - 2.0 * u, bias + 2.0 * u, colour=BLUE, opacity=0.2),
                    _samples(setting.temperature, free),
                    Line(at, bias),
                ),
                x=Axis("temperature, degC"),
                y=Axis("bias, deg/h"),
            ),
        ),
    )


def _residuals(one_axis: AxisOverTemperature, fit: BiasFit) -> Plot:
    return Plot(
        f"Residuals over the record, {one_axis.axis}",
        "Output less the solution. Slow waves are the random walk and the bias instability, which "
        "the fitted noise holds; a shape that follows the temperature is not.",
        (
            Panel(
                (
                    _samples(_hours(one_axis), fit.residual),
                    Rule(y=0.0, colour=BLUE, width=1.4, dashes="--"),
                ),
                x=Axis("time, h"),
                y=Axis("residual, deg/h"),
            ),
        ),
    )


def _table(one_axis: AxisOverTemperature, fit: BiasFit) -> Table:
    low, high = one_axis.setting.domain
    whose = "the chamber's" if one_axis.setting.lag_prior_s is None else "the gyro's own"
    rows = []
    for place in np.linspace(-1.0, 1.0, ROWS):
        at = 0.5 * (low + high) + 0.5 * (high - low) * place
        value, u = fit.bias_at(float(place))
        rows.append([f"{at:.2f}", *format_with_uncertainty(value, COVERAGE * u)])
    return Table(
        f"Compensation, {one_axis.axis}",
        f"Take the bias off the output at {whose} temperature, at rest. U is for 95 %.",
        ["temperature, degC", "bias, deg/h", "U, deg/h"],
        rows,
    )
