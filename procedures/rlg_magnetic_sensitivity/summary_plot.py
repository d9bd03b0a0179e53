"""Plot of all axes: best estimates, published values and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from station.report.drawing import BLUE, INK, VERMILION, new_figure

BEST = "best estimate with U (95 %)"
PUBLISHED = "published formula (has no sign)"
WITHIN = "within the limit"
LIMIT = "limit"
ORDER = (BEST, PUBLISHED, WITHIN, LIMIT)


@dataclass(frozen=True)
class SummaryRow:
    """One axis of the summary: value with U, the published value, and the limit's interval."""

    axis: str
    value: float | None
    expanded_uncertainty: float | None
    published: float | None
    limit: tuple[float, float] | None


def summary(rows: Sequence[SummaryRow]) -> Figure:
    """Draw all axes' values with U, the published values beside them, and the limits behind."""
    figure = new_figure(1.15 + 0.5 * len(rows))
    axes = figure.add_subplot()
    spans = [abs(b) for row in rows if row.limit for b in row.limit if np.isfinite(b)]
    spans += [
        abs(row.value) + (row.expanded_uncertainty or 0.0) for row in rows if row.value is not None
    ]
    spans += [row.published for row in rows if row.published is not None]
    reach = 1.12 * max(spans, default=1.0) or 1.0
    told: set[str] = set()

    def once(text: str) -> str | None:
        new = text not in told
        told.add(text)
        return text if new else None

    for place, row in enumerate(rows):
        if row.limit is not None:
            low, high = np.clip(row.limit, -reach, reach)
            axes.add_patch(
                Rectangle(
                    (low, place - 0.38),
                    high - low,
                    0.76,
                    facecolor="#E6F1F7",
                    edgecolor="none",
                    zorder=1,
                    label=once(WITHIN),
                )
            )
            for bound in row.limit:
                if np.isfinite(bound):
                    axes.plot(
                        [bound, bound],
                        [place - 0.38, place + 0.38],
                        color=INK,
                        linewidth=1.6,
                        zorder=2,
                        label=once(LIMIT),
                    )
        if row.value is None:
            axes.text(
                0.0,
                place,
                "undetermined",
                ha="center",
                va="center",
                style="italic",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 2.0},
            )
        else:
            axes.errorbar(
                row.value,
                place - 0.1,
                xerr=row.expanded_uncertainty or None,
                fmt="o",
                color=BLUE,
                markersize=6,
                capsize=4,
                elinewidth=1.8,
                zorder=4,
                label=once(BEST),
            )
        if row.published is not None:
            axes.plot(
                row.published,
                place + 0.22,
                "D",
                markersize=6,
                markerfacecolor="white",
                markeredgecolor=VERMILION,
                markeredgewidth=1.5,
                zorder=3,
                linestyle="none",
                label=once(PUBLISHED),
            )
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(range(len(rows)), [row.axis for row in rows])
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    axes.set_xlabel("magnetic sensitivity, deg/h/mT")
    handles, names = axes.get_legend_handles_labels()
    order = sorted(range(len(names)), key=lambda i: ORDER.index(names[i]))
    axes.legend(
        [handles[i] for i in order],
        [names[i] for i in order],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=4,
        handlelength=1.6,
    )
    return figure
