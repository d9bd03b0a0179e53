"""Phase diagram: the response of each axis over its field, in the complex plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from procedures.rlg_magnetic_sensitivity.findings import LineDetail
from procedures.rlg_magnetic_sensitivity.plots import COLOUR
from station.report.drawing import INK, new_figure

WITHIN_95 = 2.448
"""Root of chi-square with two degrees of freedom at 95 %."""


def phase_diagram(lines: Sequence[LineDetail]) -> Figure:
    """Draw each line's response over field with the region where 95 % of such results would lie.

    Right is in phase with the field, up is a quarter period before it; both axes to one scale.
    """
    figure = new_figure(3.9)
    axes = figure.add_subplot()
    reach = 0.0
    told: set[str] = set()
    for line in lines:
        if line.slope is None or line.slope_uncertainty is None:
            continue
        quadrature = line.quadrature or 0.0
        tall = line.quadrature_uncertainty or line.slope_uncertainty
        wide = line.slope_uncertainty
        colour = COLOUR[line.axis]
        axes.add_patch(
            Ellipse(
                (line.slope, quadrature),
                2.0 * WITHIN_95 * wide,
                2.0 * WITHIN_95 * tall,
                facecolor=colour,
                alpha=0.15,
                edgecolor="none",
            )
        )
        axes.annotate(
            "",
            (line.slope, quadrature),
            (0.0, 0.0),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6},
        )
        name = f"{line.axis} at {line.frequency_Hz:.3g} Hz"
        axes.plot(
            line.slope,
            quadrature,
            "o",
            color=colour,
            markersize=4,
            label=None if name in told else name,
        )
        told.add(name)
        reach = max(
            reach,
            abs(line.slope) + WITHIN_95 * wide,
            abs(quadrature) + WITHIN_95 * tall,
        )
    reach = 1.1 * reach or 1.0
    for share in (0.5, 1.0):
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        radius = share * reach / 1.1
        axes.plot(
            radius * np.cos(turn), radius * np.sin(turn), color=INK, linewidth=0.4, linestyle=":"
        )
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_aspect("equal")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("in phase with the field, deg/h/mT")
    axes.set_ylabel("a quarter period before, deg/h/mT")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure
