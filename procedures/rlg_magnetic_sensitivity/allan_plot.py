"""Plot of the Allan deviation of each record, with the noise that was fitted to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from procedures.rlg_magnetic_sensitivity.findings import SegmentDetail
from procedures.rlg_magnetic_sensitivity.plots import COLOUR
from procedures.rlg_magnetic_sensitivity.tables import joined
from station.report.drawing import BLACK, new_figure

MARKERS = "os^Dv<>"


def allan(segments: Sequence[SegmentDetail]) -> Figure:
    """Draw deviation against averaging time, both logarithmic, with standard uncertainties."""
    figure = new_figure(3.6)
    axes = figure.add_subplot()
    for number, detail in enumerate(segments):
        found = detail.allan
        if not len(found.tau_s):
            continue
        colour = COLOUR[detail.axes[0]] if len(detail.axes) == 1 else BLACK
        axes.errorbar(
            found.tau_s,
            found.deviation,
            np.minimum(found.standard_uncertainty, 0.9 * found.deviation),
            fmt=MARKERS[number % len(MARKERS)],
            color=colour,
            markersize=3.5,
            elinewidth=0.8,
            label=f"{joined(detail.axes)} driven",
        )
        if detail.noise is not None:
            tau_s = np.geomspace(found.tau_s[0], found.tau_s[-1], 120)
            axes.plot(tau_s, detail.noise.deviation_deg_per_h(tau_s), color=colour, linewidth=1.0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("averaging time τ, s")
    axes.set_ylabel("Allan deviation σ(τ), deg/h")
    axes.legend(loc="upper right")
    return figure
