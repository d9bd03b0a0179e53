"""How far the gyro's own temperature stands behind the chamber's."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from procedures.estimation.measured import Measured

from .dataset import Array
from .thermal import lagged

SHORTEST_ROWS = 0.2
"""Of an interval: a lag below it cannot be distinguished from none."""
MAX_PART = 0.3
"""Of the record: a longer lag has no end to be seen."""
IN_A_ROW = 0.005
"""Of an interval: what rows that are means leave unknown of the corners of a ramp."""
MIN_RANGE = 2.0


def chamber_lag(gyro: Array, chamber: Array, interval_s: float) -> Measured | None:
    """Return the first-order lag in s of a gyro's thermometer (n,) behind a chamber's, degC.

    The two may differ by a constant, and begin apart. None where the chamber hardly moved.
    """
    if float(np.ptp(chamber)) < MIN_RANGE:
        return None
    time_s = interval_s * np.arange(len(gyro))

    def columns(lag_s: float) -> Array:
        begins = np.exp(-time_s / lag_s)
        return np.column_stack([lagged(chamber, lag_s, interval_s), np.ones(len(gyro)), begins])

    def left(log_lag: float) -> Array:
        own = columns(float(np.exp(log_lag)))[:, 1:]
        target = gyro - lagged(chamber, float(np.exp(log_lag)), interval_s)
        return np.asarray(target - own @ np.linalg.lstsq(own, target, rcond=None)[0])

    shortest, longest = SHORTEST_ROWS * interval_s, MAX_PART * float(time_s[-1])
    grid = np.linspace(np.log(shortest), np.log(longest), 25)
    squares = [float(np.sum(left(float(tried)) ** 2)) for tried in grid]
    at = int(np.argmin(squares))
    if at in (0, len(grid) - 1):
        return None
    best = minimize_scalar(
        lambda tried: float(np.sum(left(tried) ** 2)), bounds=(grid[at - 1], grid[at + 1])
    )
    lag_s = float(np.exp(best.x))
    residual = left(best.x)
    derivative = (left(best.x + 1e-3) - left(best.x - 1e-3)) / (2e-3 * lag_s)
    own = columns(lag_s)[:, 1:]
    derivative = derivative - own @ np.linalg.lstsq(own, derivative, rcond=None)[0]
    # Neighbours are correlated where the gyro is no first-order system: fewer of them count.
    lag_one = float(np.clip(residual[1:] @ residual[:-1] / (residual @ residual), 0.0, 0.99))
    variance = float(residual @ residual) / (len(gyro) - 4) * (1 + lag_one) / (1 - lag_one)
    own_u = variance / float(derivative @ derivative)
    return Measured(lag_s, float(np.sqrt(own_u + (IN_A_ROW * interval_s) ** 2)))
