"""The history as one HTML page: each result over time, over its units, and its control chart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from station.decision import Limit
from station.history.alarms import Known, alarms_of, rows_of_standards
from station.history.charts import FEWEST, Chart
from station.history.series import Series
from station.history.store import Entry
from station.parts import Part, Table, first_rows
from station.plots import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    Axis,
    Item,
    Panel,
    Plot,
    Points,
    Rule,
    Steps,
)
from station.report.html import render_parts
from station.report.numbers import format_limit, format_with_uncertainty

COLOURS = (BLUE, ORANGE, BLACK, GREY, VERMILION)
LIMIT = Rule(colour=VERMILION, width=1.0, dashes="--")
BINS_AT_MOST = 20
SECONDS_PER_DAY = 86400.0


def page_of(series: Sequence[Series], about: str, known: Known = MappingProxyType({})) -> str:
    """Return the page of some rows of results; `about` says what was asked for.

    `known` is who took note of which alarm.
    """
    parts = [part for row in series for part in _parts(row, known)]
    return render_parts("Results over time", about, [*_alarms(series, known), *parts])


def _alarms(series: Sequence[Series], known: Known) -> Iterator[Part]:
    """Yield a table of the alarms of check standards, the newest first."""
    rows = [
        (
            alarm.identity,
            alarm.entry.bench,
            alarm.sentence(),
            "; ".join(
                f"{note.who}, {note.acknowledged_utc[:10]}: {note.reason}"
                for note in alarm.acknowledged
            )
            or "STANDS",
        )
        for alarm in reversed(alarms_of([e for row in series for e in row.entries], known))
    ]
    if rows:
        columns = ("Alarm", "Bench", "Value", "Acknowledged")
        yield first_rows("Alarms of check standards", "The newest first.", columns, rows)


def _parts(series: Series, known: Known) -> Iterator[Part]:
    """Yield what is drawn of one row of results."""
    if not series.values:
        return
    title = f"{series.procedure}: {series.title}"
    yield _over_time(title, series)
    for own in rows_of_standards(series.entries, known):
        chart = own.chart()
        if chart is not None:
            yield _chart(f"{title}, check standard {own.entries[0].serial}", own, chart)
    units = series.newest_of_each_unit()
    if len(units) >= FEWEST:
        yield _units(f"{title}, over the units", series, units)
    yield _table(series)


def _over_time(title: str, series: Series) -> Plot:
    items: list[Item] = []
    serials = list(dict.fromkeys(entry.serial for entry in series.entries))
    for number, serial in enumerate(serials):
        mine = [
            entry for entry in series.entries if entry.serial == serial and entry.value is not None
        ]
        items.append(
            Points(
                [_day(entry) for entry in mine],
                [entry.value or 0.0 for entry in mine],
                bars=[entry.expanded_uncertainty or 0.0 for entry in mine],
                colour=COLOURS[number % len(COLOURS)],
                cap=2.0,
                joined=0.8,
                label=serial if len(serials) > 1 and number < len(COLOURS) else "",
            )
        )
    items += [replace(LIMIT, y=bound) for bound in _limits(series)]
    panel = Panel(tuple(items), x=Axis(dates=True), y=Axis(series.unit))
    return Plot(title, _caption(series), (panel,), 2.8)


def _chart(title: str, series: Series, chart: Chart) -> Plot:
    values = series.values
    numbers = range(1, len(values) + 1)
    alarms = sorted(chart.alarms)
    upper: tuple[Item, ...] = (
        Points(numbers, values, size=3.0, joined=1.4),
        *(
            Rule(y=chart.centre + side * chart.sigma, colour=GREY, width=0.8, dashes=dashes)
            for zone, dashes in ((0, "-"), (1, ":"), (2, ":"), (3, "--"))
            for side in sorted({-zone, zone})
        ),
        Points(
            [n + 1 for n in alarms],
            [values[n] for n in alarms],
            marker="s",
            size=6.0,
            colour=VERMILION,
        ),
    )
    ranges = [abs(b - a) for a, b in pairwise(values)]
    lower = (
        Points(numbers[1:], ranges, size=3.0, joined=1.4),
        Rule(y=chart.largest_range, colour=GREY, width=0.8, dashes="--"),
    )
    return Plot(
        title,
        _chart_caption(chart),
        (
            Panel(upper, title=f"Individual values, {series.unit}"),
            Panel(lower, title=f"Moving range, {series.unit}", x=Axis("run"), row=1),
        ),
        4.2,
        share_x="column",
    )


def _units(title: str, series: Series, units: Sequence[Entry]) -> Plot:
    values = [unit.value for unit in units if unit.value is not None]
    bins = min(BINS_AT_MOST, math.ceil(math.sqrt(len(units))) + 1)
    heights, edges = np.histogram(values, bins)
    items: tuple[Item, ...] = (
        Steps(edges, heights, colour=BLUE),
        *(replace(LIMIT, x=bound) for bound in _limits(series)),
    )
    panel = Panel(items, x=Axis(series.unit), y=Axis("units"))
    return Plot(title, _units_caption(series, units), (panel,), 2.6)


def _limits(series: Series) -> list[float]:
    last = series.entries[-1]
    return [bound for bound in (last.limit_min, last.limit_max) if bound is not None]


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
    begun = datetime.fromisoformat(entry.started_utc[:19]).replace(tzinfo=UTC)
    return begun.timestamp() / SECONDS_PER_DAY
