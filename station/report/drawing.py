"""One look for all plots: sizes, colours that everybody can tell apart, and the PNG file."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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


def new_figure(height_in: float = 3.4) -> Figure:
    """Return an empty figure on white, as wide as the page; draw inside `mpl.rc_context(STYLE)`."""
    figure = Figure(figsize=(WIDTH_IN, height_in), facecolor="white")
    figure.subplots_adjust(left=0.08, right=0.985)
    return figure


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as a PNG file: the same bytes for the same drawing, no software tag."""
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(
            buffer, format="png", dpi=DPI, bbox_inches="tight", metadata={"Software": None}
        )
    return buffer.getvalue()


def label_above(axes: Axes, text: str) -> None:
    """Write a short plain title above the panel, flush left."""
    axes.set_title(text, loc="left", fontsize=9.0, color=INK, pad=6)
