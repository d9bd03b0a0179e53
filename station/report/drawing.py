"""Plots drawn for paper by Matplotlib: one look, and the PNG file."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogFormatterSciNotation, MaxNLocator, NullFormatter

from station.errors import InputError
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
from station.report.pdf import FIRST_IDEOGRAPH, font_with
from station.report.typesetting import with_signs
from station.texts import ENGLISH, IN_ENGLISH, Texts, whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Translate = Callable[[str], str]
DPI = 110
CSS_DPI = 96
WIDTH_IN = 9.4
LEFT_IN = 0.72
RIGHT_IN = 0.14
BOTTOM_IN = 0.48
TOP_IN = 0.3
STRIP_LEFT, STRIP_WIDTH, RIGHT_WITH_STRIP = 0.925, 0.014, 0.9
INK = PALETTE["ink"]
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.edgecolor": "#6B7280",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.titley": 1.0,  # else every title is placed by measuring all labels of its panel first
    "grid.color": "#E5E7EB",
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": "#4B5563",
    "ytick.color": "#4B5563",
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.4,
    "path.simplify": True,
    "path.simplify_threshold": 0.5,
    "agg.path.chunksize": 0,
}
POWER = re.compile(r"\^\{(-?\d+)\}")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MAPS = {"difference": "RdBu_r", "angle": "hsv"}
MARKERS = {"vermilion": "s", "green": "D", "orange": "P", "purple": "X", "sky": "*"}
DASHES: dict[str, Any] = {
    "vermilion": (0, (6, 1.5)),
    "green": (0, (2, 1)),
    "orange": (0, (6, 1.5, 1, 1.5)),
    "purple": (0, (1, 1)),
    "sky": (0, (10, 2)),
}
"""What tells a colour on a grey print: of round markers, and of whole lines in a legend."""
LEGENDS: dict[str, dict[str, Any]] = {
    "above": {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)},
    "above right": {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)},
    "beside": {"loc": "center left", "bbox_to_anchor": (1.02, 0.5)},
}


class Decades(LogFormatterSciNotation):
    """Powers of ten as plain text: setting formulas takes a tenth of a report's time."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the text at a number, empty where it would stand too close to others."""
        formula = str(super().__call__(x, pos)).removeprefix(r"$\mathdefault{").removesuffix("}$")
        text = POWER.sub(lambda power: power[1].translate(RAISED), formula)
        return text.replace(r"\times", "×").replace("-", "−")


def png_of(plot: Plot, texts: Texts = IN_ENGLISH) -> bytes:
    """Return a plot as a PNG file: the same bytes for the same plot, no software tag."""
    texts, style = drawn_in(texts.languages[0])
    return png_bytes(figure_of(plot, texts, style), style)


@cache
def drawn_in(language: str) -> tuple[Texts, dict[str, Any]]:
    """Return the texts of a language and the style with a font for it; English where none is."""
    if language == ENGLISH:
        return IN_ENGLISH, STYLE
    signs = {sign for text in whole(language).values() for sign in text}
    try:
        file, family = font_with({sign for sign in signs if ord(sign) >= FIRST_IDEOGRAPH})
    except InputError:
        return IN_ENGLISH, STYLE
    fontManager.addfont(file)
    # It tells everybody which weight it took in the place of another.
    logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
    return Texts(language), {**STYLE, "font.family": [str(STYLE["font.family"]), family]}


def png_bytes(figure: Figure, style: dict[str, Any] = STYLE) -> bytes:
    """Return a figure as a PNG file."""
    buffer = io.BytesIO()
    with mpl.rc_context(style):
        figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def figure_of(plot: Plot, texts: Texts = IN_ENGLISH, style: dict[str, Any] = STYLE) -> Figure:
    """Return a plot as a figure on white, as wide as the page.

    The margins hold labels and a line of title. They are fixed, so that all plots of a page stand
    in line, and because finding them by drawing twice costs a third of a report's time.
    """
    with mpl.rc_context(style):
        figure = Figure(figsize=(WIDTH_IN, plot.height_in), facecolor="white")
        strips = any(panel.scale and panel.scale.strip for panel in plot.panels)
        grid = figure.add_gridspec(
            1 + max(panel.row for panel in plot.panels),
            max(panel.column + panel.columns for panel in plot.panels),
            width_ratios=plot.widths or None,
            height_ratios=plot.heights or None,
            wspace=plot.gap_x,
            hspace=plot.gap_y,
            left=LEFT_IN / WIDTH_IN,
            right=RIGHT_WITH_STRIP if strips else 1.0 - RIGHT_IN / WIDTH_IN,
            bottom=BOTTOM_IN / plot.height_in,
            top=1.0 - TOP_IN / plot.height_in,
        )
        made: list[tuple[Panel, Axes]] = []

        def typeset(text: str) -> str:
            return with_signs(texts(text))

        for panel in plot.panels:
            axes = figure.add_subplot(
                grid[panel.row, panel.column : panel.column + panel.columns],
                sharex=_shared(made, panel, plot.share_x, "column"),
                sharey=_shared(made, panel, plot.share_y, "row"),
            )
            made.append((panel, axes))
        for panel, axes in made:
            _fill(axes, panel, typeset)
        for panel, axes in made:
            _finish(axes, panel, plot, typeset)
        for strip in {panel.row: (panel, axes) for panel, axes in made if panel.scale}.values():
            _strip(figure, *strip, typeset)
        if len({panel.row for panel in plot.panels}) > 1:
            figure.align_ylabels([axes for panel, axes in made if panel.column == 0])
    return figure


def _shared(
    made: Sequence[tuple[Panel, Axes]], panel: Panel, shared: str, along: str
) -> Axes | None:
    """Return the panel whose axis this one has too, None where it has its own."""
    for other, axes in made:
        if shared == "all" or (shared and getattr(other, along) == getattr(panel, along)):
            return axes
    return None


def _fill(axes: Axes, panel: Panel, texts: Translate) -> None:
    """Draw the items of a panel, and its legend."""
    for axis, own, scale in (
        (panel.x, axes.xaxis, axes.set_xscale),
        (panel.y, axes.yaxis, axes.set_yscale),
    ):
        if axis.log:
            scale("log")
            own.set_major_formatter(Decades())
            own.set_minor_formatter(Decades() if axis.between else NullFormatter())
    handles: dict[str, Any] = {}
    for number, item in enumerate(panel.items):
        handle = _draw(axes, item, panel, 2.0 + number / 100.0, texts)
        if label := getattr(item, "label", ""):
            handles.setdefault(texts(label), handle)
    axes.autoscale_view()  # patches and arrows do not ask for it
    if handles and panel.legend:
        where = LEGENDS.get(panel.legend) or {"loc": panel.legend, "borderaxespad": 0.2}
        axes.legend(
            handles.values(),
            handles.keys(),
            ncols=panel.legend_columns,
            handlelength=1.6,
            columnspacing=1.0 if panel.legend not in LEGENDS else 2.0,
            **where,
        )


def _draw(axes: Any, item: Item, panel: Panel, order: float, texts: Translate) -> Any:
    """Draw an item, and return what stands for it in the legend."""
    colour = _colour(getattr(item, "colour", INK), panel.scale)
    if isinstance(item, Line):
        named = item.label and item.dashes == "-" and str(item.colour)
        return axes.plot(
            item.x,
            item.y,
            linestyle=DASHES.get(named or "", item.dashes),
            color=colour,
            linewidth=item.width,
            alpha=item.opacity,
            zorder=order,
        )[0]
    if isinstance(item, Points):
        return _points(axes, item, colour, panel.scale, order)
    if isinstance(item, Band):
        return axes.fill_between(
            item.x,
            item.low,
            item.high,
            color=colour,
            alpha=item.opacity,
            linewidth=0.0,
            zorder=order,
        )
    if isinstance(item, Rule):
        look = {"color": colour, "linewidth": item.width, "linestyle": item.dashes}
        if item.x is not None:
            return axes.axvline(item.x, zorder=order, **look)
        return axes.axhline(item.y, zorder=order, **look)
    if isinstance(item, Region):
        look = {"facecolor": colour, "alpha": item.opacity, "edgecolor": "none", "zorder": order}
        if item.x is None and item.y is not None:
            return axes.axhspan(*item.y, **look)
        if item.x is not None and item.y is None:
            return axes.axvspan(*item.x, **look)
        (left, right), (low, high) = item.x or (0.0, 0.0), item.y or (0.0, 0.0)
        return axes.add_patch(Rectangle((left, low), right - left, high - low, **look))
    if isinstance(item, Ellipse):
        size = 2.0 * item.half_width, 2.0 * item.half_height
        look = {"facecolor": colour, "alpha": item.opacity, "edgecolor": "none", "zorder": order}
        return axes.add_patch(EllipsePatch((item.x, item.y), *size, **look))
    if isinstance(item, Steps):
        way = "horizontal" if item.sideways else "vertical"
        return axes.stairs(
            item.heights, item.edges, orientation=way, fill=True, color=colour, zorder=order
        )
    if isinstance(item, Arrow):
        look = {"arrowstyle": "-|>", "color": colour, "linewidth": item.width}
        axes.update_datalim([(item.x, item.y), (item.from_x, item.from_y)])
        ends = (item.x, item.y), (item.from_x, item.from_y)
        return axes.annotate("", *ends, arrowprops=look, zorder=order)
    if isinstance(item, Note):
        return axes.text(
            item.x,
            item.y,
            texts(item.text),
            ha=item.across,
            va=item.upright,
            fontsize=item.size,
            color=colour,
            style="italic" if item.slanted else "normal",
            zorder=order,
            **({"transform": axes.transAxes} if item.inside else {}),
            **(
                {"bbox": {"facecolor": "white", "edgecolor": "none", "pad": 2.0}}
                if item.boxed
                else {}
            ),
        )
    return _cells(axes, item, panel.scale)


def _points(axes: Axes, item: Points, colour: Any, scale: Scale | None, order: float) -> Any:
    if item.values is not None and scale is not None:
        return axes.scatter(
            item.x,
            item.y,
            c=item.values,
            cmap=MAPS[scale.colours],
            vmin=scale.low,
            vmax=scale.high,
            s=item.size**2,
            marker=item.marker,
            edgecolors=PALETTE["grey"],
            linewidths=0.3,
            zorder=order,
        )
    marker, size = item.marker, item.size
    if marker in (".", "o") and not item.fill and item.colour in MARKERS:
        marker, size = MARKERS[str(item.colour)], size / 2.0 if marker == "." else size
    look = {
        "marker": marker or "none",
        "markersize": size,
        "color": colour,
        "linestyle": "-" if item.joined else "none",
        "linewidth": item.joined,
        "alpha": item.opacity,
        "clip_on": not item.beyond,
        "zorder": order,
    }
    if item.fill:
        look |= {"markerfacecolor": _colour(item.fill, scale), "markeredgewidth": item.edge}
    if item.bars is None and item.bars_x is None:
        return axes.plot(item.x, item.y, **look)[0]
    del look["clip_on"]
    return axes.errorbar(
        item.x,
        item.y,
        item.bars,
        item.bars_x,
        elinewidth=item.bar_width,
        capsize=item.cap,
        **look,
    )


def _cells(axes: Axes, item: Cells, scale: Scale | None) -> None:
    assert scale is not None
    cells = np.array(item.rows, dtype=np.float64)
    axes.imshow(
        cells, cmap=MAPS[scale.colours], vmin=scale.low, vmax=scale.high, aspect="auto", zorder=1
    )
    dark = 0.65 * max(abs(scale.low), abs(scale.high))
    for (row, column), cell in np.ndenumerate(cells):
        axes.text(
            column,
            row,
            f"{round(cell, 2) + 0.0:.2f}".replace("-", "−"),
            ha="center",
            va="center",
            fontsize=7.5,
            color="white" if abs(cell) > dark else INK,
        )


def _colour(colour: str | float, scale: Scale | None) -> Any:
    if isinstance(colour, str):
        return PALETTE.get(colour, colour)
    if scale is None:
        return INK
    share = (colour - scale.low) / (scale.high - scale.low)
    return mpl.colormaps[MAPS[scale.colours]](share)


def _finish(axes: Axes, panel: Panel, plot: Plot, texts: Translate) -> None:
    """Set the limits, ticks and labels of a panel, once everything is drawn."""
    both: tuple[tuple[Literal["x", "y"], Axis, Any], ...]
    both = (("x", panel.x, axes.xaxis), ("y", panel.y, axes.yaxis))
    for name, axis, own in both:
        if axis.label:
            own.set_label_text(texts(axis.label))
        if axis.ticks is not None:
            own.set_ticks(axis.ticks)
            if axis.texts:
                own.set_ticklabels([texts(text) for text in axis.texts])
        elif axis.most:
            own.set_major_locator(MaxNLocator(axis.most, prune="upper"))
        elif axis.dates:
            own.set_major_locator(locator := AutoDateLocator())
            own.set_major_formatter(ConciseDateFormatter(locator))
        if not plot.numbers_at(panel, name):
            axes.tick_params(axis=name, labelbottom=False, labelleft=False)
        if axis.turned:
            axes.tick_params(axis=name, labelrotation=45)
        if not axis.grid:
            axes.grid(False, axis=name)
            axes.tick_params(axis=name, length=0)
        limits(axes, name, axis)
    if panel.equal:
        axes.set_aspect("equal")
    if panel.title:
        axes.set_title(texts(panel.title), loc="left", fontsize=9.0, color=INK, pad=6)


def limits(axes: Axes, name: str, axis: Axis) -> None:
    """Set the limits that an axis states, with room above what is drawn."""
    low, high = getattr(axes, f"get_{name}lim")()
    if axis.room and axis.log:
        high = low * (high / low) ** (1.0 + axis.room)
    else:
        high += axis.room * (high - low)
    given = (low if axis.low is None else axis.low, high if axis.high is None else axis.high)
    if axis.room or axis.low is not None or axis.high is not None:
        getattr(axes, f"set_{name}lim")(*given)


def _strip(figure: Figure, panel: Panel, axes: Axes, texts: Translate) -> None:
    """Draw what colour stands for what number, beside the panels of a row."""
    scale = panel.scale
    if scale is None or not scale.strip:
        return
    place = axes.get_position()
    strip = figure.add_axes((STRIP_LEFT, place.y0, STRIP_WIDTH, place.height))
    norm = Normalize(scale.low, scale.high)
    figure.colorbar(ScalarMappable(norm, MAPS[scale.colours]), cax=strip, ticks=scale.ticks)
    strip.set_title(texts(scale.label), fontsize=8.0, pad=4)
