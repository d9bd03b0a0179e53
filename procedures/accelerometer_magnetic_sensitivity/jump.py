"""An encoder that lost counts on the way: where the angle of all later rows is off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.orthogonal import orthogonal_part, project, thin_qr

Array = NDArray[np.float64]

FEWEST_ROWS = 6
WILDEST = 30.0


def jump_place(design: Array, slope: Array, residual: Array) -> int | None:
    """Return the row from which a change of angle explains the residuals best, None without any.

    `design` (rows, k) are the columns of the solution, `slope` (rows,) the derivative of the output
    by the angle, `residual` (rows,) what the solution left. Every row is tried at once: the sums
    from a row to the end give the fall of the squares that a column `slope` from there would make.
    Whether there is a jump at all, only a solution with it can tell.
    """
    if len(residual) < 2 * FEWEST_ROWS or not bool(np.any(slope)):
        return None
    spread = float(np.median(np.abs(residual)))
    q = thin_qr(design)[0]
    left = orthogonal_part(q, np.clip(residual, -WILDEST * spread, WILDEST * spread))
    shared = _from_each_row(q * slope[:, None])
    along = _from_each_row((slope * left)[:, None])[:, 0] - shared @ project(q, left)
    own = _from_each_row((slope**2)[:, None])[:, 0] - np.einsum("ij,ij->i", shared, shared)
    gain = np.where(own > 1e-6 * own.max(), along**2 / np.maximum(own, 1e-300), 0.0)
    gain[:FEWEST_ROWS] = 0.0
    gain[-FEWEST_ROWS:] = 0.0
    place = int(np.argmax(gain))
    return place if gain[place] > 0.0 else None


def _from_each_row(columns: Array) -> Array:
    """Return the sums of columns (n, k) from each row to the last."""
    return np.asarray(np.cumsum(columns[::-1], axis=0)[::-1])
