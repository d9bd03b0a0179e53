"""An encoder that lost counts on the way: where the angle of all later rows is off, and by what."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.orthogonal import (
    least_absolute,
    orthogonal_part,
    project,
    solve_by_qr,
    thin_qr,
)

Array = NDArray[np.float64]

FEWEST_ROWS = 6
WILDEST = 30.0
LARGEST_DEG, STEP_DEG = 12.0, 1.0
"""How far a jump is looked for, and how finely at first."""
FINER = 0.4
FINEST_DEG = 0.01
"""Its square is 0.02 µV at 1 V/g: from there on the solution finds the angle by itself."""
TURNS = 4


def jump_place(design: Array, slope: Array, residual: Array) -> tuple[int, float] | None:
    """Return the row from which a change of angle explains the residuals best, None without any.

    `design` (rows, k) are the columns of the solution, `slope` (rows,) the derivative of the output
    by the angle, `residual` (rows,) what the solution left. Every row is tried at once: the sums
    from a row to the end give the fall of the squares that a column `slope` from there would make.
    That fall comes with the row. Whether there is a jump at all, only a solution with it can tell.
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
    return (place, float(gain[place])) if gain[place] > 0.0 else None


def jump_begin(columns_at: Callable[[Array], Array], data: Array, place: int) -> tuple[int, float]:
    """Return row and angle (rad) of a jump, near enough for the solution to begin there.

    `columns_at` gives the columns (rows, k) for what is added to the encoder's angle in each row,
    (rows,) in rad. A jump of a degree bends every column, and least squares would follow the rows
    on the wrong side: so angle and row are looked for by turns, each by the sum of the magnitudes
    that the best fit leaves.
    """
    rows = np.arange(len(data))
    angle_rad = 0.0
    for _ in range(TURNS):
        later = (rows >= place).astype(np.float64)

        def cost(angle_rad: float, later: Array = later) -> float:
            return float(np.sum(np.abs(least_absolute(columns_at(angle_rad * later), data))))

        angle_rad = _smallest(cost)
        columns = columns_at(angle_rad * later)
        fitted = data - least_absolute(columns, data)
        coefficients = solve_by_qr(columns, fitted).coefficients
        before = np.abs(data - columns_at(0.0 * later) @ coefficients)
        after = np.abs(data - columns_at(angle_rad + 0.0 * later) @ coefficients)
        whole = np.concatenate(([0.0], np.cumsum(before - after)))[:-1]
        inside = slice(FEWEST_ROWS, len(rows) - FEWEST_ROWS)
        found = FEWEST_ROWS + int(np.argmin(whole[inside]))
        if found == place:
            break
        place = found
    return place, angle_rad


def _smallest(cost: Callable[[float], float]) -> float:
    """Return the angle (rad) of the smallest cost, from a coarse to a fine search."""
    step_rad = np.radians(STEP_DEG)
    count = round(LARGEST_DEG / STEP_DEG)
    tried = step_rad * np.arange(-count, count + 1)
    while True:
        best = float(tried[int(np.argmin([cost(float(one)) for one in tried]))])
        if step_rad <= np.radians(FINEST_DEG):
            return best
        step_rad *= FINER
        tried = best + step_rad * np.arange(-2, 3)


def _from_each_row(columns: Array) -> Array:
    """Return the sums of columns (n, k) from each row to the last."""
    return np.asarray(np.cumsum(columns[::-1], axis=0)[::-1])
