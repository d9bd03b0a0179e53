"""Map an instrument's own counter or clock to run time by the earliest arrivals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
    earliest. Of all such lines the one with the least mean lateness is an edge of the lower hull
    of the points: the edge above the mean counter. `counter` and `arrival_s` have shape (rows,),
    ascending; `nominal_rate` is seconds a count.

    The offset's uncertainty is that of the earliest of n arrivals whose lateness spreads evenly
    over its observed range: range / n for the number of separate arrivals, at two touching points.
    """
    centre = float(counter.mean())
    x, y = counter - centre, arrival_s - nominal_rate * (counter - centre)
    # Of rows that arrived together only the last can touch the line.
    last = np.flatnonzero(np.append(np.diff(arrival_s) > 0.0, True))
    hull = last[lower_hull(x[last], y[last])]
    after = int(np.searchsorted(x[hull], 0.0).clip(1, max(len(hull) - 1, 1)))
    if len(hull) < 2:
        tilt, height = 0.0, float(y.min())
    else:
        left, right = hull[after - 1], hull[after]
        tilt = float((y[right] - y[left]) / (x[right] - x[left]))
        height = float(y[left] - tilt * x[left])
    lateness = y - height - tilt * x
    rate = nominal_rate + tilt
    arrivals = len(np.unique(arrival_s))
    spread = float(np.quantile(lateness, 0.95))
    return Alignment(height - rate * centre, rate, 2 * spread / arrivals)


def unwrapped(sequence: NDArray[Any]) -> NDArray[np.float64]:
    """Return a 16-bit running number continued beyond its wraps, shape (rows,)."""
    steps = np.mod(np.diff(sequence.astype(np.int64)), 65536)
    return np.concatenate([[0], np.cumsum(steps)]).astype(np.float64)


def lower_hull(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[int]:
    """Return the indices of the lower convex hull of points ascending in x (monotone chain)."""
    hull: list[int] = []
    for index in range(len(x)):
        while len(hull) >= 2:
            first, last = hull[-2], hull[-1]
            turn = (x[last] - x[first]) * (y[index] - y[first]) - (y[last] - y[first]) * (
                x[index] - x[first]
            )
            if turn > 0:
                break
            hull.pop()
        if hull and x[index] == x[hull[-1]]:
            continue
        hull.append(index)
    return hull
