"""Map an instrument's own counter or clock to run time by the earliest arrivals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_KEPT = 2**19
"""Rows of a long record that the alignment holds in memory; fewer are all held."""


@dataclass(frozen=True)
class Alignment:
    """run time = offset_s + rate * counter; `offset_u_s` is the offset's standard uncertainty."""

    offset_s: float
    rate: float
    offset_u_s: float

    def run_time_s(self, counter: Array) -> Array:
        """Return the run time in s of each counter value, shape (rows,)."""
        return self.offset_s + self.rate * counter


def align(counter: Array, arrival_s: Array, nominal_rate: float) -> Alignment:
    """Fit the line below all arrivals that comes closest to them.

    A row can only arrive late, so the true line lies below every arrival and touches the
    earliest. Of all such lines the one with the least mean lateness is an edge of the lower hull
    of the points: the edge above the mean counter. `counter` and `arrival_s` have shape (rows,),
    ascending; `nominal_rate` is seconds a count.

    The offset's uncertainty is that of the earliest of n arrivals whose lateness spreads evenly
    over its observed range: range / n for the number of separate arrivals, at two touching points.
    """
    return align_pieces([(counter, arrival_s)], nominal_rate)


def align_pieces(pieces: Iterable[tuple[Array, Array]], nominal_rate: float) -> Alignment:
    """Align as `align` does, from the rows of a record in pieces, each in its turn.

    The hull is that of all rows: what is forgotten of a long record cannot touch the line. How
    late rows are is taken from every n-th row of a long record, which serves as well as all.
    """
    touching: list[Array] = []
    seen: list[Array] = []
    rows, total, arrivals = 0, 0.0, 0
    for counter, arrival_s in pieces:
        piece = np.column_stack((counter, arrival_s))
        rows, total = rows + len(piece), total + float(counter.sum())
        arrivals += len(np.unique(arrival_s))
        touching.append(piece)
        seen.append(piece)
        if sum(map(len, touching)) > MAX_KEPT:
            touching = [possible_vertices(np.concatenate(touching), nominal_rate)]
        if sum(map(len, seen)) > MAX_KEPT:
            seen = [rows[:: 2 if len(rows) > 1 else 1] for rows in seen]
    centre = total / rows
    counter, arrival_s = np.concatenate(touching).T
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
    counter, arrival_s = np.concatenate(seen).T
    x, y = counter - centre, arrival_s - nominal_rate * (counter - centre)
    lateness = y - height - tilt * x
    rate = nominal_rate + tilt
    spread = float(np.quantile(lateness, 0.95))
    return Alignment(height - rate * centre, rate, 2 * spread / arrivals)


def possible_vertices(points: Array, nominal_rate: float) -> Array:
    """Return the points (m, 2) of (n, 2), ascending, that a vertex of their lower hull may be.

    A point on or above the line between its neighbours is none.
    """
    while len(points) > 2:
        x = points[:, 0] - points[0, 0]
        y = points[:, 1] - points[0, 1] - nominal_rate * x
        turn = (x[1:-1] - x[:-2]) * (y[2:] - y[:-2]) - (y[1:-1] - y[:-2]) * (x[2:] - x[:-2])
        below = np.concatenate(([True], turn > 0.0, [True]))
        if bool(below.all()):
            break
        points = points[below]
    return points


def unwrapped(sequence: NDArray[Any]) -> Array:
    """Return a 16-bit running number continued beyond its wraps, shape (rows,)."""
    steps = np.mod(np.diff(sequence.astype(np.int64)), 65536)
    return np.concatenate([[0], np.cumsum(steps)]).astype(np.float64)


def lower_hull(along: Array, up: Array) -> list[int]:
    """Return the indices of the lower convex hull of points ascending in x (monotone chain)."""
    x, y = along.tolist(), up.tolist()  # one by one, NumPy's own numbers take four times as long
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
