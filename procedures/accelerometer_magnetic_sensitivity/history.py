"""What the rows before one leave in it: where the field came from, and what it warmed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .dataset import Rows

Array = NDArray[np.float64]
OFTEN = 1.5
"""Fields before a field, on average: with fewer, what they leave is a shape over the field."""


def direction(commanded_T: Array) -> Array:
    """Return +1 where the field has come up last, -1 where it has come down, 0 before it moved."""
    steps = np.sign(np.diff(commanded_T, prepend=commanded_T[:1]))
    moved = np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(steps)), 0))
    return np.asarray(steps[moved])


def warmth(rows: Rows, constant: float) -> Array:
    """Return the square of the field as a body of a time constant follows it, zero mean (rows,).

    `constant` in intervals of the rows. A row is read at the end of its own interval; before the
    first the body has the mean of all rows.
    """
    square = (rows.field_T / (float(np.max(np.abs(rows.field_T))) or 1.0)) ** 2
    steps_s = np.diff(rows.time_s, prepend=rows.time_s[0])
    kept = np.exp(-steps_s / (constant * (float(np.median(steps_s)) or 1.0)))
    followed = np.full(len(square), float(np.mean(square)))
    for row in range(1, len(square)):
        followed[row] = square[row] + kept[row] * (followed[row - 1] - square[row])
    return np.asarray(followed - np.mean(followed))


def tells_history(commanded_T: Array) -> bool:
    """Whether the same fields come after different ones, as they do not in the published order."""
    if len(commanded_T) < 2:
        return False
    pairs = np.unique(np.column_stack((commanded_T[:-1], commanded_T[1:])), axis=0)
    return len(pairs) >= OFTEN * len(np.unique(commanded_T))
