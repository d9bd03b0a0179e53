"""What warming and cooling turns of one log differ by: hysteresis, or a thermometer that lags."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from procedures.estimation.orthogonal import solve_by_qr
from station.findings import Flag

from .curve import CHECKED, chebyshev_columns
from .dataset import set_means
from .solution import AxisFit

WAY_DEGC = 0.1
"""From set to set: the gyro warms, or cools."""
CHANCE = 1e-6
"""How often noise alone makes branches that differ."""
SHAPE_ORDER = 3
"""Of the difference over temperature: a lag makes one that follows the slope of the curve."""
FEWEST_SETS = 10


def two_ways(fit: AxisFit) -> tuple[AxisFit, list[Flag]]:
    """Return an axis with what its warming and cooling turns differ by in u, and the flag of it.

    A curve between the two branches of a loop leaves residuals of one sign on each. The difference
    may change its sign over the range; on the average a lag then shows nothing.
    """
    kept = fit.kept & np.isfinite(fit.error_ppm)
    if fit.curve is None or int(kept.sum()) < 2 * FEWEST_SETS:
        return fit, []
    turns = fit.turns
    heat, left = set_means(
        turns.set_number[kept], turns.temperature_degC[kept], fit.residual_ppm[kept]
    )
    slope = np.gradient(heat) if len(heat) > 1 else np.zeros(1)
    branches = [slope > WAY_DEGC, slope < -WAY_DEGC]
    if min(int(branch.sum()) for branch in branches) < FEWEST_SETS:
        return fit, []
    shared = (
        max(heat[branch].min() for branch in branches),
        min(heat[branch].max() for branch in branches),
    )
    inside = (heat >= shared[0]) & (heat <= shared[1])
    if min(int((branch & inside).sum()) for branch in branches) < FEWEST_SETS:
        return fit, []
    rows = inside & (branches[0] | branches[1])
    way = np.where(branches[0][rows], 1.0, -1.0)
    columns = chebyshev_columns(heat[rows], shared, SHAPE_ORDER) * way[:, None]
    solved = solve_by_qr(columns, left[rows])
    free = int(rows.sum()) - columns.shape[1]
    explained = float(left[rows] @ left[rows]) - solved.sum_of_squares
    ratio = explained / columns.shape[1] / max(solved.sum_of_squares / free, 1e-300)
    if fdtrc(columns.shape[1], free, ratio) > CHANCE:
        return fit, []
    grid = np.clip(fit.curve.temperatures_degC(CHECKED), *shared)
    half = chebyshev_columns(grid, shared, SHAPE_ORDER) @ solved.coefficients
    worst = int(np.argmax(np.abs(half)))
    ways_text = (
        f"The turns about {fit.axis} while the gyro cools differ by up to {-2.0 * half[worst]:+.2g}"
        f" ppm (at {grid[worst]:.0f} degC) from those while it warms: hysteresis, or a thermometer "
        "that lags. The curve lies between them; half of it is in the uncertainty."
    )
    widened = replace(fit, curve=fit.curve.checked(np.abs(half)))
    size = {"size_ppm": float(2.0 * np.abs(half[worst]))}
    return widened, [Flag("hysteresis", ways_text, fit.axis, size)]
