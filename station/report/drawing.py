"""One look for all plots: sizes, colours that everybody can tell apart, and the PNG file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from station.findings import Findings
    from station.parts import Part
    from station.procedure import Procedure
    from station.results import ResultDocument

# Okabe and Ito, Color Universal Design (2008).
BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8A9099"
PALE = "#C9CED6"
INK = "#1F2933"

DPI = 110
CSS_DPI = 96
WIDTH_IN = 9.4
LEFT_IN = 0.72
RIGHT_IN = 0.14
BOTTOM_IN = 0.48
TOP_IN = 0.3
STYLE = {
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


def parts_of(procedure: Procedure, findings: Findings, document: ResultDocument) -> Sequence[Part]:
    """Return what a procedure adds to the report, its plots drawn in the style of the page."""
    with mpl.rc_context(STYLE):
        return procedure.report(findings, document)


def new_figure(height_in: float = 3.4) -> Figure:
    """Return an empty figure on white, as wide as the page; drawn in STYLE by `parts_of`.

    The margins hold labels and a line of title. They are fixed, so that all plots of a page stand
    in line, and because finding them by drawing twice costs a third of a report's time.
    """
    figure = Figure(figsize=(WIDTH_IN, height_in), facecolor="white")
    figure.subplots_adjust(
        left=LEFT_IN / WIDTH_IN,
        right=1.0 - RIGHT_IN / WIDTH_IN,
        bottom=BOTTOM_IN / height_in,
        top=1.0 - TOP_IN / height_in,
    )
    return figure


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as a PNG file: the same bytes for the same drawing, no software tag."""
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def label_above(axes: Axes, text: str) -> None:
    """Write a short plain title above the panel, flush left."""
    axes.set_title(text, loc="left", fontsize=9.0, color=INK, pad=6)


def panels(figure: Figure, count: int, columns: int, *, share_x: bool, share_y: bool) -> list[Axes]:
    """Return `count` panels row by row; the rest of the last row stays empty."""
    columns = min(count, columns)
    grid = figure.subplots(-(-count // columns), columns, sharex=share_x, sharey=share_y)
    every: list[Axes] = list(np.atleast_1d(grid).flat)
    for axes in every[count:]:
        axes.set_visible(False)
    return every[:count]


def label_outer(grid: Sequence[Axes], columns: int, below: str, beside: str) -> None:
    """Name the axes at the left edge and below the last panel of each column."""
    for number, axes in enumerate(grid):
        last = number + columns >= len(grid)
        axes.tick_params(labelbottom=last)
        if last:
            axes.set_xlabel(below)
        if number % columns == 0:
            axes.set_ylabel(beside)
