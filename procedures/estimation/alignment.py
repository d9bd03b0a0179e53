"""Map an instrument's own counter or clock to run time by the earliest arrivals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

LARGEST_RATE_ERROR = 1e-3


@dataclass(frozen=True)
class Alignment:
    """run time = offset_s + rate * counter; `offset_u_s` is the offset's standard uncertainty."""

    offset_s: float
    rate: float
    offset_u_s: float

    def run_time_s(self, counter: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the run time in s of each counter value, shape (rows,)."""
        return self.offset_s + self.rate * counter


def align(
    counter: NDArray[np.float64], arrival_s: NDArray[np.float64], nominal_rate: float
) -> Alignment:
    """Fit the line below all arrivals that comes closest to them.

    A row can only arrive late, so the true line lies below every arrival and touches the
    earliest; the mean lateness is minimised under that condition (a linear programme). `counter`
    and `arrival_s` have shape (rows,), ascending; `nominal_rate` is seconds a count.

    The offset's uncertainty is that of the earliest of n arrivals whose lateness spreads evenly
    over its observed range: range / n for the number of separate arrivals, at two touching points.
    """
    centre, first = float(counter.mean()), float(arrival_s[0])
    x, y = counter - centre, arrival_s - first - nominal_rate * (counter - counter[0])
    # Unknowns: height at the centre and deviation of the rate, scaled to about one each.
    span = max(float(np.ptp(x)), 1.0)
    design = np.column_stack([np.ones_like(x), x / span])
    widest = LARGEST_RATE_ERROR * nominal_rate * span
    solved = linprog(
        c=-design.mean(axis=0),
        A_ub=design,
        b_ub=y,
        bounds=[(None, None), (-widest, widest)],
        method="highs",
    )
    height, tilt = solved.x
    rate = nominal_rate + tilt / span
    offset_s = first + height - nominal_rate * float(counter[0] - centre) - rate * centre
    lateness = y - design @ solved.x
    arrivals = len(np.unique(arrival_s))
    spread = float(np.quantile(lateness, 0.95))
    return Alignment(float(offset_s), float(rate), 2 * spread / arrivals)
