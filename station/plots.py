"""A plot as data: panels with their axes, and in each lines, points and a few other kinds of item.

Drawn for paper by `station.report.drawing`, for the browser by `station.panel.figures`. Colours are
names of PALETTE, or a number on the colour scale of the panel. Items are drawn in their order, and
those with a label stand in the legend in the same order, equal labels once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, MISSING, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar, cast

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Numbers = Sequence[float] | Sequence[int] | NDArray[np.float64] | NDArray[np.int64]

# Okabe and Ito, Color Universal Design (2008).
PALETTE = {
    "black": "#000000",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "green": "#009E73",
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "purple": "#CC79A7",
    "grey": "#8A9099",
    "pale": "#C9CED6",
    "mist": "#E6F1F7",
    "ink": "#1F2933",
    "white": "#FFFFFF",
}
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, PURPLE, GREY, PALE, MIST, INK, WHITE = PALETTE
DIGITS = 6
MAX_ROWS = 4000
"""Rows of an item that are kept: more than a page or a screen has pixels."""


@dataclass(frozen=True)
class Line:
    """A line through points, in their order; NaN leaves a gap."""

    x: Numbers
    y: Numbers
    _: KW_ONLY
    colour: str | float = BLUE
    width: float = 1.4
    dashes: str = "-"
    """One of - -- : -."""
    opacity: float = 1.0
    label: str = ""


@dataclass(frozen=True)
class Points:
    """Markers, with bars where a half length is given for each.

    `values` colour each by the panel's scale; `joined` is the width of a line through them;
    `beyond` draws those at the edge of the panel whole.
    """

    x: Numbers
    y: Numbers
    _: KW_ONLY
    colour: str | float = BLUE
    marker: str = "o"
    """One of . o s D ^ v < > x, or nothing."""
    size: float = 4.0
    fill: str = ""
    """What fills the markers where it is not their colour: white, none."""
    edge: float = 1.0
    """Width of the edge of such a marker."""
    bars: Numbers | None = None
    bars_x: Numbers | None = None
    bar_width: float = 0.8
    cap: float = 0.0
    joined: float = 0.0
    values: Numbers | None = None
    beyond: bool = False
    opacity: float = 1.0
    label: str = ""


@dataclass(frozen=True)
class Band:
    """What lies between two curves."""

    x: Numbers
    low: Numbers
    high: Numbers
    _: KW_ONLY
    colour: str | float = SKY
    opacity: float = 0.4
    label: str = ""


@dataclass(frozen=True)
class Rule:
    """A straight line across the whole panel, at one `x` or at one `y`."""

    _: KW_ONLY
    x: float | None = None
    y: float | None = None
    colour: str | float = INK
    width: float = 0.6
    dashes: str = "-"
    label: str = ""


@dataclass(frozen=True)
class Region:
    """A rectangle; without `x` or without `y` it goes across the whole panel."""

    _: KW_ONLY
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    colour: str | float = GREY
    opacity: float = 0.25
    label: str = ""


@dataclass(frozen=True)
class Ellipse:
    """An ellipse about a point, with half its width and half its height."""

    x: float
    y: float
    half_width: float
    half_height: float
    _: KW_ONLY
    colour: str | float = BLUE
    opacity: float = 0.15
    label: str = ""


@dataclass(frozen=True)
class Steps:
    """A histogram: filled heights between edges, one more of these; `sideways` along y."""

    edges: Numbers
    heights: Numbers
    _: KW_ONLY
    colour: str | float = PALE
    sideways: bool = False
    label: str = ""


@dataclass(frozen=True)
class Note:
    """A text in the panel, at numbers of its axes, or with `inside` at fractions of the panel."""

    x: float
    y: float
    text: str
    _: KW_ONLY
    inside: bool = False
    size: float = 9.0
    across: str = "center"
    """How the text lies to its place: left, center, right."""
    upright: str = "center"
    """bottom, center, top."""
    colour: str = INK
    slanted: bool = False
    boxed: bool = False
    """On white."""


@dataclass(frozen=True)
class Arrow:
    """An arrow to a point, from another."""

    x: float
    y: float
    from_x: float = 0.0
    from_y: float = 0.0
    _: KW_ONLY
    colour: str | float = BLUE
    width: float = 1.6


@dataclass(frozen=True)
class Cells:
    """A table of numbers on the colours of the panel's scale; the first row is on top.

    Column and row are at the numbers 0, 1, …: ticks of the axes name them.
    """

    rows: Sequence[Sequence[float]]


Item = Line | Points | Band | Rule | Region | Ellipse | Steps | Note | Arrow | Cells


@dataclass(frozen=True)
class Axis:
    """One axis of a panel; what is not said follows from what is drawn.

    `room` is the share above the data that stays free for a legend. `ticks` are where numbers, or
    `texts` instead of them, stand, none where it is empty; `most` is how many there are at most.
    `numbers` and `grid`: whether they are drawn. `dates`: numbers are days since 1970-01-01.
    `low` above `high` turns the axis round.
    """

    label: str = ""
    _: KW_ONLY
    low: float | None = None
    high: float | None = None
    log: bool = False
    room: float = 0.0
    ticks: Numbers | None = None
    texts: tuple[str, ...] = ()
    turned: bool = False
    most: int = 0
    numbers: bool = True
    between: bool = True
    """Whether a logarithmic axis has numbers between its decades where it is short."""
    grid: bool = True
    dates: bool = False


@dataclass(frozen=True)
class Scale:
    """What colour stands for what number: `difference` (blue, white, red), or `angle` (a circle).

    With `strip` it is drawn at the right edge of the plot.
    """

    low: float
    high: float
    _: KW_ONLY
    colours: str = "difference"
    label: str = ""
    ticks: Numbers | None = None
    strip: bool = True


@dataclass(frozen=True)
class Panel:
    """Axes and what is drawn in them; `columns` of the plot wide.

    `legend` is best, a corner such as `upper right`, `above`, `above right`, or `beside`.
    """

    items: tuple[Item, ...]
    _: KW_ONLY
    title: str = ""
    x: Axis = Axis()
    y: Axis = Axis()
    row: int = 0
    column: int = 0
    columns: int = 1
    legend: str = "best"
    legend_columns: int = 1
    equal: bool = False
    """Both axes to one scale."""
    scale: Scale | None = None


@dataclass(frozen=True)
class Plot:
    """Panels in rows and columns, with one or two sentences that say what to see.

    `widths` and `heights` are those of columns and rows to one another. `gap_x` and `gap_y` lie
    between panels, in mean panels. `share_x` (column, all) and `share_y` (row, all) give panels one
    axis, with numbers below, or left of, the outer panel only.
    """

    title: str
    caption: str
    panels: tuple[Panel, ...]
    height_in: float = 3.4
    _: KW_ONLY
    widths: tuple[float, ...] = ()
    heights: tuple[float, ...] = ()
    gap_x: float = 0.2
    gap_y: float = 0.2
    share_x: str = ""
    share_y: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.panels, tuple):
            raise TypeError(f"the plot {self.title!r} is drawn; make it of panels of station.plots")

    def numbers_at(self, panel: Panel, name: str) -> bool:
        """Whether the axis `x` or `y` of a panel has numbers; of a shared one the outer panel."""
        axis: Axis = getattr(panel, name)
        if name == "x":
            hidden = bool(self.share_x) and any(
                other.column == panel.column and other.row > panel.row for other in self.panels
            )
        else:
            hidden = bool(self.share_y) and any(
                other.row == panel.row and other.column < panel.column for other in self.panels
            )
        return axis.numbers and not hidden


def in_grid(
    panels: Sequence[Panel], columns: int, below: str, beside: str, *, share_y: bool = False
) -> tuple[Panel, ...]:
    """Return panels row by row; the left ones and the last of each column name the axes."""
    columns = min(len(panels), columns)
    placed = []
    for number, panel in enumerate(panels):
        row, column = divmod(number, columns)
        last = number + columns >= len(panels)
        x = replace(panel.x, label=below if last else "", numbers=last)
        numbers = column == 0 or not share_y
        y = replace(panel.y, label=beside if column == 0 else "", numbers=numbers)
        placed.append(replace(panel, row=row, column=column, x=x, y=y))
    return tuple(placed)


MODEL = {
    kind.__name__: kind
    for kind in (Line, Points, Band, Rule, Region, Ellipse, Steps, Note, Arrow, Cells)
}
PARTS = {"Axis": Axis, "Scale | None": Scale, "tuple[Panel, ...]": Panel}
Made = TypeVar("Made")


def to_data(thing: Any, most: int = MAX_ROWS) -> dict[str, Any]:
    """Return a plot, or a part of one, as JSON data; what has its usual value is left out.

    Items of more than `most` rows are thinned, numbers rounded to what can be seen.
    """
    data: dict[str, Any] = {}
    if type(thing) in MODEL.values():
        data["kind"] = type(thing).__name__.lower()
        thing = thinned(thing, most)
    for field in fields(thing):
        value = getattr(thing, field.name)
        if field.type in ("Numbers", "Numbers | None"):
            value = None if value is None else rounded(value)
        elif field.name == "rows":
            value = [rounded(row) for row in value]
        elif isinstance(value, tuple | list) and field.name in ("panels", "items"):
            value = [to_data(inner, most) for inner in value]
        elif field.type in PARTS and value is not None:
            value = to_data(value, most)
        elif isinstance(value, tuple):
            value = [number_of(number) for number in value]
        elif not isinstance(value, bool):
            value = number_of(value)
        usual = field.default
        if field.type in PARTS and value == {}:
            continue
        if usual is MISSING or value != (list(usual) if isinstance(usual, tuple) else usual):
            data[field.name] = value
    return data


def plot_of(data: Mapping[str, Any]) -> Plot:
    """Return the plot that `to_data` wrote; raises ValueError, TypeError or KeyError."""
    return _made(Plot, data)


def _made(kind: type[Made], data: Mapping[str, Any]) -> Made:
    values: dict[str, Any] = {}
    for field in fields(kind):  # type: ignore[arg-type]
        if field.name not in data:
            continue
        value = data[field.name]
        if field.type in ("Numbers", "Numbers | None"):
            value = None if value is None else _numbers(value)
        elif field.name == "rows":
            value = [_numbers(row) for row in value]
        elif field.name == "panels":
            value = tuple(_made(Panel, panel) for panel in value)
        elif field.name == "items":
            value = tuple(_made(MODEL[item["kind"].capitalize()], item) for item in value)
        elif field.type in PARTS and value is not None:
            value = _made(PARTS[cast(str, field.type)], value)
        elif isinstance(value, list):
            value = tuple(value)
        values[field.name] = value
    return kind(**values)


def _numbers(values: Sequence[float | None]) -> list[float]:
    return [math.nan if value is None else float(value) for value in values]


def number_of(value: Any) -> Any:
    """Return a number as Python's own, and anything else as it is."""
    if isinstance(value, str | bool | int) or value is None:
        return value
    return float(f"{float(value):.12g}") if math.isfinite(value) else None


def rounded(values: Numbers) -> list[float | None]:
    """Return numbers with as many digits as can be seen next to one another; NaN as None."""
    numbers = [float(value) for value in values]
    finite = [value for value in numbers if math.isfinite(value)]
    if not finite:
        return [None] * len(numbers)
    low, high = min(finite), max(finite)
    farthest = max(-low, high)
    apart = math.log10(farthest / (high - low)) if high > low else 0.0
    form = f"%.{DIGITS + min(max(math.ceil(apart), 0), 17 - DIGITS)}g"
    return [float(form % value) if math.isfinite(value) else None for value in numbers]


def thinned(item: Made, most: int = MAX_ROWS) -> Made:
    """Return an item of at most `most` rows: those with the extremes of each stretch are kept."""
    judged = {"Line": ("y",), "Points": ("y",), "Band": ("low", "high")}.get(type(item).__name__)
    if judged is None or len(cast(Any, item).x) <= most:
        return item
    import numpy as np

    x = np.asarray(cast(Any, item).x)
    names = judged if np.all(x[1:] >= x[:-1]) else (*judged, "x")
    columns = [np.asarray(getattr(item, name), dtype=np.float64) for name in names]
    gaps = np.logical_or.reduce([np.isnan(column) for column in columns])
    stretches = (most - 2) // (2 * len(columns) + bool(gaps.any())) - 1
    size = -(-len(x) // stretches)
    kept = [np.array([0, len(x) - 1])]
    whole = len(x) - len(x) % size
    for first, end in ((0, whole), (whole, len(x))):  # all stretches, then what is left
        begins = np.arange(first, end, size)
        if not len(begins):
            continue
        for column in columns:
            block = column[first:end].reshape(len(begins), -1)
            missing = np.isnan(block)
            kept.append(begins + np.argmin(np.where(missing, np.inf, block), axis=1))
            kept.append(begins + np.argmax(np.where(missing, -np.inf, block), axis=1))
        block = gaps[first:end].reshape(len(begins), -1)
        kept.append((begins + np.argmax(block, axis=1))[block.any(axis=1)])
    chosen = np.unique(np.concatenate(kept))
    thinner = {
        field.name: np.asarray(value)[chosen]
        for field in fields(cast(Any, item))
        if field.type in ("Numbers", "Numbers | None")
        and (value := getattr(item, field.name)) is not None
    }
    return cast(Made, replace(cast(Any, item), **thinner))
