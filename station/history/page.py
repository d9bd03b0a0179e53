"""The history as one HTML page: each result over time, over its units, and its control chart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure

from station.decision import Limit
from station.history.charts import FEWEST, Chart
from station.history.series import Series
from station.history.store import Entry
from station.parts import Part, Plot, Table, first_rows
from station.report.drawing import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    STYLE,
    VERMILION,
    label_above,
    new_figure,
)
from station.report.html import render_parts
from station.report.numbers import format_limit, format_with_uncertainty

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (BLUE, ORANGE, BLACK, GREY, VERMILION)
BINS_AT_MOST = 20


def page_of(series: Sequence[Series], about: str) -> str:
    """Return the page of some rows of results; `about` says what was asked for."""
    with mpl.rc_context(STYLE):
        return render_parts(
            "Results over time", about, [p for series in series for p in _parts(series)]
        )


def _parts(series: Series) -> Iterator[Part]:
    """Yield what is drawn of one row of results."""
    if not series.values:
        return
    title = f"{series.procedure}: {series.title}"
    yield Plot(title, _caption(series), _over_time(series))
    standards = [entry for entry in series.entries if entry.check_standard]
    for serial in dict.fromkeys(standard.serial for standard in standards):
        own = Series(
            series.procedure,
            series.name,
            series.axis,
            series.unit,
            series.simulated,
            [standard for standard in standards if standard.serial == serial],
        )
        chart = own.chart()
        if chart is not None:
            yield Plot(
                f"{title}, check standard {serial}", _chart_caption(chart), _chart(own, chart)
            )
    units = series.newest_of_each_unit()
    if len(units) >= FEWEST:
        yield Plot(f"{title}, over the units", _units_caption(series, units), _units(series, units))
    yield _table(series)


def _over_time(series: Series) -> Figure:
    figure = new_figure(2.8)
    axes = figure.subplots()
    serials = list(dict.fromkeys(entry.serial for entry in series.entries))
    for number, serial in enumerate(serials):
        mine = [
            entry for entry in series.entries if entry.serial == serial and entry.value is not None
        ]
        axes.errorbar(
            [_day(entry) for entry in mine],
            [entry.value or 0.0 for entry in mine],
            [entry.expanded_uncertainty or 0.0 for entry in mine],
            fmt="o-",
            markersize=4,
            linewidth=0.8,
            capsize=2,
            color=COLOURS[number % len(COLOURS)],
            label=serial if number < len(COLOURS) else None,
        )
    last = series.entries[-1]
    for bound in (last.limit_min, last.limit_max):
        if bound is not None:
            axes.axhline(bound, color=VERMILION, linewidth=1.0, linestyle="--")
    if len(serials) > 1:
        axes.legend()
    _date_axis(axes)
    axes.set_ylabel(series.unit)
    return figure


def _chart(series: Series, chart: Chart) -> Figure:
    figure = new_figure(4.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    values = series.values
    numbers = range(1, len(values) + 1)
    upper.plot(numbers, values, "o-", markersize=3, color=BLUE)
    for zone, style in ((0, "-"), (1, ":"), (2, ":"), (3, "--")):
        for side in {-zone, zone}:
            upper.axhline(
                chart.centre + side * chart.sigma, color=GREY, linewidth=0.8, linestyle=style
            )
    alarms = sorted(chart.alarms)
    upper.plot([n + 1 for n in alarms], [values[n] for n in alarms], "s", color=VERMILION)
    label_above(upper, f"Individual values, {series.unit}")
    lower.plot(
        numbers[1:], [abs(b - a) for a, b in pairwise(values)], "o-", markersize=3, color=BLUE
    )
    lower.axhline(chart.largest_range, color=GREY, linewidth=0.8, linestyle="--")
    label_above(lower, f"Moving range, {series.unit}")
    lower.set_xlabel("run")
    return figure


def _units(series: Series, units: Sequence[Entry]) -> Figure:
    figure = new_figure(2.6)
    axes = figure.subplots()
    bins = min(BINS_AT_MOST, math.ceil(math.sqrt(len(units))) + 1)
    axes.hist([unit.value for unit in units if unit.value is not None], bins=bins, color=BLUE)
    last = series.entries[-1]
    for bound in (last.limit_min, last.limit_max):
        if bound is not None:
            axes.axvline(bound, color=VERMILION, linewidth=1.0, linestyle="--")
    axes.set_xlabel(series.unit)
    axes.set_ylabel("units")
    return figure


def _caption(series: Series) -> str:
    runs, units = len(series.entries), len({entry.serial for entry in series.entries})
    return (
        f"{runs} runs of {units} units; bars are the expanded uncertainty U, dashed lines the "
        "limits of the newest run."
    )


def _chart_caption(chart: Chart) -> str:
    if not chart.alarms:
        state = "In control: no value breaks a Western Electric rule."
    elif chart.out_of_control:
        state = f"OUT OF CONTROL: the newest value is {chart.alarms[chart.newest]}."
    else:
        state = f"In control now; {len(chart.alarms)} earlier values broke a rule."
    return f"{state} Centre and sigma are those of the first {chart.baseline} runs."


def _units_caption(series: Series, units: Sequence[Entry]) -> str:
    cpk = series.capability()
    sentence = "no limit, or no spread: there is no Cpk" if cpk is None else f"Cpk {cpk:.2f}"
    return f"The newest result of each of {len(units)} units; {sentence}."


def _table(series: Series) -> Table:
    rows = []
    for entry in reversed(series.entries):
        value, uncertainty = format_with_uncertainty(entry.value, entry.expanded_uncertainty)
        limit = None
        if entry.limit_min is not None or entry.limit_max is not None:
            limit = Limit(entry.limit_min, entry.limit_max)
        row = (entry.started_utc[:16].replace("T", " "), entry.serial, value, uncertainty)
        rows.append((*row, format_limit(limit), entry.verdict, entry.run))
    columns = ("UTC", "Unit", f"Value, {series.unit}", "U", "Limit", "Verdict", "Run")
    return first_rows("", "The newest first.", columns, rows)


def _day(entry: Entry) -> float:
    return float(date2num(datetime.fromisoformat(entry.started_utc)))


def _date_axis(axes: Axes) -> None:
    locator = AutoDateLocator()
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
