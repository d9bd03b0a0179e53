"""A plot of a procedure for the browser: data and layout as Plotly takes them."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise
from typing import Any

from station.plots import (
    PALETTE,
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
)
from station.texts import IN_ENGLISH, Texts

PX_PER_IN, PX_PER_POINT, LEAST_PX = 96, 96 / 72, 2.0
DAY_MS = 86_400_000
WHOLE: tuple[float | None, float | None] = (None, None)
EDGE = 0.05
"""Share of what is drawn that stays free at each end of an axis."""
DASHES = {"-": "solid", "--": "dash", ":": "dot", "-.": "dashdot"}
SYMBOLS = {
    ".": "circle",
    "o": "circle",
    "s": "square",
    "D": "diamond",
    "^": "triangle-up",
    "v": "triangle-down",
    "<": "triangle-left",
    ">": "triangle-right",
    "x": "x-thin-open",
}
COLOURS = {
    "difference": ("#053061", "#4393C3", "#F7F7F7", "#D6604D", "#67001F"),
    "angle": tuple(
        "#" + "".join(f"{round(255 * part):02X}" for part in colorsys.hsv_to_rgb(n / 12, 1.0, 1.0))
        for n in range(13)
    ),
}
UPRIGHT = {"bottom": "bottom", "center": "middle", "top": "top"}
AXIS = {"zeroline": False, "linecolor": "#6B7280", "ticks": "outside", "gridcolor": "#E5E7EB"}
Data = dict[str, Any]


def figure_of(plot: Plot, texts: Texts = IN_ENGLISH) -> Data:
    """Return a plot as the data and the layout of a Plotly figure, as wide as its place."""
    figure = _Figure(plot, texts)
    for number, panel in enumerate(plot.panels, 1):
        figure.add(panel, "" if number == 1 else str(number))
    return {"data": figure.traces, "layout": figure.layout}


class _Figure:
    """A figure while its panels are added to it."""

    def __init__(self, plot: Plot, texts: Texts) -> None:
        self._plot, self._texts = plot, texts
        columns = max(panel.column + panel.columns for panel in plot.panels)
        rows = 1 + max(panel.row for panel in plot.panels)
        self._columns = _domains(columns, plot.widths, plot.gap_x)
        self._rows = [(1.0 - b, 1.0 - a) for a, b in _domains(rows, plot.heights, plot.gap_y)]
        self._first: dict[tuple[str, int], str] = {}
        self.traces: list[Data] = []
        self.layout: Data = {
            "height": round(plot.height_in * PX_PER_IN),
            "margin": {"l": 70, "r": 15, "t": 30, "b": 45},
            "paper_bgcolor": "white",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"size": 12, "color": PALETTE["ink"]},
            "shapes": [],
            "annotations": [],
        }

    def add(self, panel: Panel, number: str) -> None:
        """Add a panel; `number` is empty for the first one, as Plotly has it."""
        across = (
            self._columns[panel.column][0],
            self._columns[panel.column + panel.columns - 1][1],
        )
        upright = self._rows[panel.row]
        self._axis("x", number, panel, across)
        self._axis("y", number, panel, upright)
        if panel.title:
            self._write(panel.title, number, 0.0, 1.0, xanchor="left", yanchor="bottom")
        legend = f"legend{number}"
        self.layout[legend] = _legend(panel, across, upright)
        seen: set[str] = set()
        for item in panel.items:
            label = getattr(item, "label", "")
            shown = {"showlegend": bool(label and panel.legend) and label not in seen}
            seen.add(label)
            named = {"legend": legend, **shown, "name": escape(self._texts(label))}
            if isinstance(item, Rule | Region | Ellipse):
                place = {"xref": f"x{number}", "yref": f"y{number}"}
                self.layout["shapes"].append({**place, **_shape(item, panel, number), **named})
            elif isinstance(item, Note):
                self._note(item, panel, number)
            elif isinstance(item, Arrow):
                self.layout["annotations"].append(_arrow(item, panel, number))
            else:
                axes = {"xaxis": f"x{number}", "yaxis": f"y{number}"}
                self.traces.append({**_trace(item, panel), **axes, **named})

    def _axis(self, name: str, number: str, panel: Panel, domain: tuple[float, float]) -> None:
        axis: Axis = getattr(panel, name)
        shared = self._plot.share_x if name == "x" else self._plot.share_y
        group = self._group(name, panel)
        first = self._first.setdefault(group, f"{name}{number}") if shared else f"{name}{number}"
        made: Data = {
            **AXIS,
            "domain": list(domain),
            "anchor": f"{'y' if name == 'x' else 'x'}{number}",
            "showgrid": axis.grid,
            "showticklabels": self._plot.numbers_at(panel, name),
        }
        if axis.label:
            made["title"] = {"text": escape(self._texts(axis.label)), "standoff": 6}
        if axis.log or axis.dates:
            made["type"] = "log" if axis.log else "date"
        if axis.ticks is not None:
            made |= {"tickmode": "array", "tickvals": [_dated(at, axis) for at in axis.ticks]}
            if axis.texts:
                made["ticktext"] = [escape(self._texts(text)) for text in axis.texts]
        if axis.most:
            made["nticks"] = axis.most
        if axis.turned:
            made["tickangle"] = -45
        if first != f"{name}{number}":
            made["matches"] = first
        if panel.equal and name == "y":
            made |= {"scaleanchor": f"x{number}", "constrain": "domain"}
        elif panel.equal:
            made["constrain"] = "domain"
        sharing = [other for other in self._plot.panels if self._group(name, other) == group]
        made |= _range(name, panel, sharing if shared else (panel,))
        self.layout[f"{name}axis{number}"] = made

    def _group(self, name: str, panel: Panel) -> tuple[str, int]:
        """Return which panels have an axis together, where axes are shared."""
        if (self._plot.share_x if name == "x" else self._plot.share_y) == "all":
            return name, 0
        return name, panel.column if name == "x" else panel.row

    def _note(self, item: Note, panel: Panel, number: str) -> None:
        """Write a text into a panel."""
        x, y = item.x, item.y
        if not item.inside:
            x, y = _at(x, panel.x), _at(y, panel.y)
        look = {
            "xanchor": item.across,
            "yanchor": UPRIGHT[item.upright],
            "font": {"size": item.size * PX_PER_POINT, "color": _colour(item.colour, None)},
            "bgcolor": "white" if item.boxed else "rgba(0,0,0,0)",
        }
        self._write(item.text, number, x, y, inside=item.inside, slanted=item.slanted, **look)

    def _write(
        self,
        text: str,
        number: str,
        x: float,
        y: float,
        *,
        inside: bool = True,
        slanted: bool = False,
        **look: Any,
    ) -> None:
        domain = " domain" if inside else ""
        place = {"x": x, "y": y, "xref": f"x{number}{domain}", "yref": f"y{number}{domain}"}
        words = escape(self._texts(text))
        words = f"<i>{words}</i>" if slanted else words
        self.layout["annotations"].append({**place, "text": words, "showarrow": False, **look})


def _domains(count: int, sizes: Sequence[float], gap: float) -> list[tuple[float, float]]:
    """Return where each of several panels in line begins and ends, with a gap in mean panels."""
    sizes = sizes or (1.0,) * count
    mean = 1.0 / (count + gap * (count - 1))
    scale, at, domains = mean * count / sum(sizes), 0.0, []
    for size in sizes:
        domains.append((at, min(at + scale * size, 1.0)))
        at += scale * size + gap * mean
    return domains


def _legend(panel: Panel, across: tuple[float, float], upright: tuple[float, float]) -> Data:
    where = "upper right" if panel.legend in ("best", "") else panel.legend
    look: Data = {
        "x": across[1],
        "xanchor": "right",
        "y": upright[1],
        "yanchor": "top",
        "orientation": "h" if panel.legend_columns > 1 else "v",
        "bgcolor": "rgba(255,255,255,0.9)",
        "font": {"size": 11},
    }
    if where == "beside":
        middle = sum(upright) / 2.0
        return look | {"x": across[1] + 0.02, "xanchor": "left", "y": middle, "yanchor": "middle"}
    if "above" in where:
        look |= {"yanchor": "bottom"}
    if "lower" in where:
        look |= {"y": upright[0], "yanchor": "bottom"}
    if "left" in where:
        look |= {"x": across[0], "xanchor": "left"}
    if where == "above" or "center" in where:
        look |= {"x": sum(across) / 2.0, "xanchor": "center"}
    return look


def _range(name: str, panel: Panel, sharing: Sequence[Panel]) -> Data:
    """Return the range of an axis where it is stated, shared or has room; else Plotly finds it."""
    axis: Axis = getattr(panel, name)
    axes: list[Axis] = [getattr(other, name) for other in sharing]
    low = next((other.low for other in axes if other.low is not None), None)
    high = next((other.high for other in axes if other.high is not None), None)
    if low is not None and high is not None:
        return {"range": [_at(low, axis), _at(high, axis)]}
    room = max(other.room for other in axes)
    if len(sharing) == 1 and not room and low is None and high is None:
        turned = name == "y" and any(isinstance(item, Cells) for item in panel.items)
        return {"autorange": "reversed"} if turned else {}
    reached = [at for other in sharing for item in other.items for at in _reached(name, item)]
    drawn = [_at(at, axis) for at in reached if math.isfinite(at) and (at > 0.0 or not axis.log)]
    if not drawn:
        return {}
    edge = EDGE * (max(drawn) - min(drawn))
    least, greatest = min(drawn) - edge, max(drawn) + edge
    greatest += room * (greatest - least)
    least = least if low is None else _at(low, axis)
    return {"range": [least, greatest if high is None else _at(high, axis)]}


def _reached(name: str, item: Item) -> Iterator[float]:
    """Yield the numbers of one axis that an item is drawn at."""
    if isinstance(item, Steps):
        yield from item.edges if (name == "y") == item.sideways else (0.0, *item.heights)
    elif isinstance(item, Band) and name == "y":
        yield from (*item.low, *item.high)
    elif isinstance(item, Line | Points | Band):
        values = getattr(item, name)
        bars = getattr(item, "bars" if name == "y" else "bars_x", None)
        yield from values
        if bars is not None:
            for at, bar in zip(values, bars, strict=True):
                yield from (at - bar, at + bar)


def _trace(item: Line | Points | Band | Steps | Cells, panel: Panel) -> Data:
    if isinstance(item, Cells):
        rows = [_numbers(row) for row in item.rows]
        return {
            "type": "heatmap",
            "z": rows,
            "texttemplate": "%{z:.2f}",
            **_scaled(panel.scale, "z"),
        }
    if isinstance(item, Steps):
        edges, heights = _numbers(item.edges), _numbers(item.heights)
        pairs = list(pairwise(edges))
        along, up = ("y", "x") if item.sideways else ("x", "y")
        return {
            "type": "bar",
            "orientation": "h" if item.sideways else "v",
            along: [(a + b) / 2.0 for a, b in pairs],
            up: heights,
            "width": [b - a for a, b in pairs],
            "marker": {"color": _colour(item.colour, panel.scale), "line": {"width": 0}},
        }
    x = [_dated(at, panel.x) for at in _numbers(item.x)]
    colour = _colour(item.colour, panel.scale)
    if isinstance(item, Band):
        return {
            "type": "scatter",
            "mode": "lines",
            "x": [*x, *reversed(x)],
            "y": [*_numbers(item.high), *reversed(_numbers(item.low))],
            "fill": "toself",
            "fillcolor": colour,
            "opacity": item.opacity,
            "line": {"width": 0},
            "hoverinfo": "skip",
        }
    trace: Data = {"type": "scatter", "x": x, "y": _numbers(item.y), "opacity": item.opacity}
    if isinstance(item, Line):
        line = {"color": colour, "width": item.width, "dash": DASHES[item.dashes]}
        return {**trace, "mode": "lines", "line": line}
    return {**trace, **_markers(item, colour, panel.scale)}


def _markers(item: Points, colour: str, scale: Scale | None) -> Data:
    modes = [*(["lines"] if item.joined else []), *(["markers"] if item.marker else [])]
    size = max(PX_PER_POINT * item.size * (0.5 if item.marker == "." else 1.0), LEAST_PX)
    marker: Data = {"symbol": SYMBOLS.get(item.marker, "circle"), "size": size, "color": colour}
    if item.fill or item.marker == "x":
        inner = "rgba(0,0,0,0)" if item.fill == "none" else _colour(item.fill or colour, None)
        marker |= {"color": inner, "line": {"color": colour, "width": item.edge}}
    if item.values is not None:
        marker |= {"color": _numbers(item.values), **_scaled(scale, "c")}
    look: Data = {
        "mode": "+".join(modes) or "none",
        "marker": marker,
        "line": {"color": colour, "width": item.joined},
        "cliponaxis": not item.beyond,
    }
    for name, bars in (("error_y", item.bars), ("error_x", item.bars_x)):
        if bars is not None:
            thick = {"thickness": item.bar_width, "width": item.cap, "color": colour}
            look[name] = {"type": "data", "array": _numbers(bars), **thick}
    return look


def _scaled(scale: Scale | None, letter: str) -> Data:
    """Return what colours numbers by a scale; `letter` begins Plotly's names of its ends."""
    if scale is None:
        return {}
    colours = COLOURS[scale.colours]
    return {
        "colorscale": [[n / (len(colours) - 1), colour] for n, colour in enumerate(colours)],
        f"{letter}min": scale.low,
        f"{letter}max": scale.high,
        "showscale": scale.strip,
        "colorbar": {"title": {"text": escape(scale.label)}, "thickness": 12},
    }


def _shape(item: Rule | Region | Ellipse, panel: Panel, number: str) -> Data:
    colour = _colour(item.colour, panel.scale)
    if isinstance(item, Rule):
        line = {"color": colour, "width": item.width, "dash": DASHES[item.dashes]}
        place = _span("x", item.x, item.x, panel.x, number)
        place |= _span("y", item.y, item.y, panel.y, number)
        return {"type": "line", **place, "line": line, "layer": "above"}
    look = {"fillcolor": colour, "opacity": item.opacity, "line": {"width": 0}, "layer": "below"}
    if isinstance(item, Ellipse):
        place = {"x0": item.x - item.half_width, "x1": item.x + item.half_width}
        place |= {"y0": item.y - item.half_height, "y1": item.y + item.half_height}
        return {"type": "circle", **place, **look}
    left, right = item.x or WHOLE
    bottom, top = item.y or WHOLE
    place = _span("x", left, right, panel.x, number)
    place |= _span("y", bottom, top, panel.y, number)
    return {"type": "rect", **place, **look}


def _span(name: str, low: float | None, high: float | None, axis: Axis, number: str) -> Data:
    """Return the ends of a shape along an axis, those of the panel where it has none."""
    if low is None or high is None:
        return {f"{name}ref": f"{name}{number} domain", f"{name}0": 0, f"{name}1": 1}
    return {f"{name}0": _dated(low, axis), f"{name}1": _dated(high, axis)}


def _arrow(item: Arrow, panel: Panel, number: str) -> Data:
    return {
        "x": _at(item.x, panel.x),
        "y": _at(item.y, panel.y),
        "ax": _at(item.from_x, panel.x),
        "ay": _at(item.from_y, panel.y),
        **{"xref": f"x{number}", "yref": f"y{number}"},
        **{"axref": f"x{number}", "ayref": f"y{number}"},
        "text": "",
        "showarrow": True,
        "arrowhead": 2,
        "arrowcolor": _colour(item.colour, panel.scale),
        "arrowwidth": item.width,
    }


def _colour(colour: str | float, scale: Scale | None) -> str:
    if isinstance(colour, str):
        return PALETTE.get(colour, colour)
    if scale is None:
        return PALETTE["ink"]
    colours = COLOURS[scale.colours]
    share = min(max((colour - scale.low) / (scale.high - scale.low), 0.0), 1.0)
    below = min(int(share * (len(colours) - 1)), len(colours) - 2)
    part = share * (len(colours) - 1) - below
    ends = [[int(name[at : at + 2], 16) for at in (1, 3, 5)] for name in colours[below : below + 2]]
    mixed = (round(a + part * (b - a)) for a, b in zip(*ends, strict=True))
    return f"rgb({','.join(map(str, mixed))})"


def _at(at: float, axis: Axis) -> float:
    """Return a number of an axis where Plotly takes its logarithm: in ranges and annotations."""
    if axis.log:
        return math.log10(at) if at > 0.0 else 0.0
    return _dated(at, axis)


def _dated(at: float, axis: Axis) -> float:
    return at * DAY_MS if axis.dates and at is not None else at


def _numbers(values: Any) -> list[Any]:
    """Return numbers as JSON has them: null for what is none."""
    numbers = (float(value) for value in values)
    return [number if math.isfinite(number) else None for number in numbers]
