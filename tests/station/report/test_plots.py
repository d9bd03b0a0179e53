"""A plot is data: it is written and read without loss, thinned to what is seen, and drawn."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from station.parts import MAX_BYTES, Part, Table, parts_of_text, text_of_parts
from station.plots import (
    MAX_ROWS,
    Arrow,
    Axis,
    Band,
    Cells,
    Ellipse,
    Item,
    Line,
    Note,
    Panel,
    Plot,
    Points,
    Region,
    Rule,
    Scale,
    Steps,
    in_grid,
    plot_of,
    rounded,
    thinned,
    to_data,
)
from station.report.drawing import figure_of, png_of
from station.texts import Texts

X = np.linspace(0.0, 10.0, 50)
KINDS: dict[str, Item] = {
    "line": Line(X, np.sin(X), dashes="--", label="sine"),
    "points": Points(X, X, bars=0.1 * X, bars_x=0.1 * X, cap=2.0, joined=0.8, label="bars"),
    "hollow": Points(X, X, marker="D", fill="white", edge=1.5, beyond=True),
    "coloured": Points(X, X, marker="s", values=X / 10.0),
    "of the scale": Line(X, X, colour=0.3),
    "band": Band(X, X - 1.0, X + 1.0, label="band"),
    "rule": Rule(y=0.5, label="rule"),
    "upright rule": Rule(x=0.5),
    "region": Region(x=(1.0, 2.0), y=(0.0, 1.0), label="region"),
    "region along x": Region(x=(1.0, 2.0)),
    "region along y": Region(y=(1.0, 2.0)),
    "ellipse": Ellipse(1.0, 2.0, 0.5, 0.3),
    "steps": Steps([0.0, 1.0, 2.0], [3.0, 1.0], sideways=True, label="steps"),
    "note": Note(0.5, 0.9, "a note", inside=True, boxed=True, slanted=True),
    "arrow": Arrow(1.0, 2.0),
    "cells": Cells([[1.0, 0.5], [-0.5, 0.0]]),
}


def a_plot(*items: Item, **look: object) -> Plot:
    return Plot("A plot", "It shows.", (Panel(items, scale=Scale(-1.0, 1.0), **look),))  # type: ignore[arg-type]


@pytest.mark.parametrize("item", KINDS.values(), ids=KINDS)
def test_an_item_is_written_read_and_drawn(item: Item) -> None:
    data = json.loads(json.dumps(to_data(a_plot(item))))
    read = plot_of(data)
    assert to_data(read) == data
    assert type(read.panels[0].items[0]) is type(item)
    assert png_of(read) != png_of(a_plot())
    assert png_of(read) == png_of(plot_of(data)), "the same plot gives the same bytes"


def test_colours_are_distinguished_on_a_grey_print() -> None:
    colours = ("blue", "vermilion", "green", "orange", "purple", "sky")
    lines = [Line(X, X, colour=colour, label=colour) for colour in colours]
    points = [Points(X, X, colour=colour, marker=".", label=colour) for colour in colours]
    drawn = figure_of(a_plot(*lines, *points)).axes[0].lines
    looks = {(repr(line._dash_pattern), line.get_marker()) for line in drawn}  # type: ignore[attr-defined]
    assert len(looks) == len(drawn) == 12


def test_a_whole_plot_with_its_panels_and_axes_is_read_as_it_was_written() -> None:
    odd = Axis("x", low=3.0, high=-3.0, ticks=[0.0, 1.0], texts=("a", "b"), turned=True, grid=False)
    panels = (
        Panel((KINDS["line"],), title="One", x=odd, y=Axis("y", room=0.3), legend="upper right"),
        Panel((KINDS["points"],), column=1, x=Axis(log=True), y=Axis(log=True, between=False)),
        Panel((KINDS["line"],), row=1, columns=2, x=Axis(dates=True), y=Axis(most=3), equal=True),
    )
    plot = Plot("Title", "Caption", panels, 5.0, widths=(2.0, 1.0), share_y="row", gap_y=0.4)
    read = plot_of(json.loads(json.dumps(to_data(plot))))
    assert read.widths == (2.0, 1.0) and read.height_in == 5.0 and read.share_y == "row"
    assert read.panels[0].x == odd and read.panels[2] == panels[2].__class__(
        read.panels[2].items, row=1, columns=2, x=Axis(dates=True), y=Axis(most=3), equal=True
    )
    assert len(figure_of(read).axes) == 3


def test_parts_are_read_as_they_were_written_and_what_is_no_number_stays_none() -> None:
    line = Line([0.0, 1.0, 2.0], [1.0, math.nan, math.inf])
    parts: list[Part] = [a_plot(line), Table("t", "c", ("a",), (("1",),))]
    text = text_of_parts(parts)
    plot, table = parts_of_text(text)
    assert isinstance(plot, Plot) and isinstance(table, Table)
    assert "null" in text and math.isnan(plot.panels[0].items[0].y[1])
    assert list(table.columns) == ["a"] and text_of_parts([plot, table]) == text


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"parts": [{"kind": "plot"}]}', '{"parts": 1}'])
def test_what_holds_no_parts_is_said_to_be_that(text: str) -> None:
    with pytest.raises(ValueError):
        parts_of_text(text)


def test_a_long_trace_keeps_its_extremes_its_ends_and_its_gaps() -> None:
    random = np.random.default_rng(1)
    values = random.normal(size=200_000)
    values[12_345], values[54_321] = 50.0, -50.0
    values[100_000:101_000] = np.nan
    line = thinned(Line(np.arange(len(values)), values))
    y = np.asarray(line.y)
    assert len(y) <= MAX_ROWS and np.nanmax(y) == 50.0 and np.nanmin(y) == -50.0
    assert line.x[0] == 0 and line.x[-1] == len(values) - 1
    assert np.isnan(y[(np.asarray(line.x) > 100_000) & (np.asarray(line.x) < 101_000)]).all()
    short = Line([0.0], [1.0])
    assert thinned(short) is short


def test_scattered_points_keep_the_extremes_of_both_axes_and_their_bars() -> None:
    x, y = np.random.default_rng(2).normal(size=(2, 30_000))
    points = thinned(Points(x, y, bars=np.abs(y)))
    assert len(points.x) == len(points.y) <= MAX_ROWS and points.bars is not None
    for whole, kept in ((x, points.x), (y, points.y)):
        assert (np.min(kept), np.max(kept)) == (whole.min(), whole.max())
    assert np.array_equal(points.bars, np.abs(points.y))


def test_plots_of_a_revision_stay_below_two_megabytes() -> None:
    x = np.random.default_rng(3).normal(size=(100, 5000))
    parts = [a_plot(*(Line(np.arange(5000) / 7.0, row) for row in x))]
    text = text_of_parts(parts)
    assert len(text.encode()) <= MAX_BYTES
    drawn = parts_of_text(text)[0]
    assert isinstance(drawn, Plot) and len(drawn.panels[0].items) == 100


def test_a_drawn_figure_is_no_plot() -> None:
    with pytest.raises(TypeError, match="make it of panels"):
        Plot("Old", "It was drawn.", figure_of(a_plot()))  # type: ignore[arg-type]


def test_numbers_have_the_digits_that_can_be_seen() -> None:
    assert rounded([1.23456789, 0.0]) == [1.23457, 0.0]
    days = [20_000.123456, 20_000.223456]
    assert rounded(days) == days
    assert rounded([math.nan]) == [None]


def test_panels_in_a_grid_name_their_axes_at_the_edge() -> None:
    grid = in_grid([Panel(())] * 5, 2, "time", "volts", share_y=True)
    assert [(panel.row, panel.column) for panel in grid] == [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0)]
    assert [panel.x.label for panel in grid] == ["", "", "", "time", "time"]
    assert [panel.y.label for panel in grid] == ["volts", "", "volts", "", "volts"]


def test_labels_are_drawn_in_the_language_of_the_report() -> None:
    figure = figure_of(a_plot(x=Axis("Results"), title="Results"), Texts("zh"))
    assert figure.axes[0].get_xlabel() == "测试结果"
