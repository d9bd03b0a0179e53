"""Slow drift as Legendre polynomials, and how many of them the data ask for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def legendre_columns(time_s: Array, order: int, start_s: float, stop_s: float) -> Array:
    """Return the Legendre polynomials 0..order over start..stop as columns (n, order + 1)."""
    half_s = 0.5 * (stop_s - start_s) or 1.0
    scaled = (time_s - 0.5 * (start_s + stop_s)) / half_s
    columns = np.empty((len(scaled), order + 1))
    columns[:, 0] = 1.0
    if order >= 1:
        columns[:, 1] = scaled
    for n in range(2, order + 1):
        previous, before = columns[:, n - 1], columns[:, n - 2]
        columns[:, n] = ((2 * n - 1) * scaled * previous - (n - 1) * before) / n
    return columns


def drift_order(sum_of_squares: Array, samples: int, penalty: float) -> int:
    """Choose the drift order from the sums of squares of the orders 0, 1, 2 ... .

    The rule is the Bayesian information criterion with `penalty` times its usual charge of ln(n)
    per coefficient. The sums must come from whitened data: on coloured noise a plain sum of
    squares takes the noise's own wandering for drift. With penalty 1 a constant white record is
    called drifting once in about 100 times, with penalty 2 once in some thousands.
    """
    smallest = np.finfo(np.float64).tiny
    orders = np.arange(len(sum_of_squares))
    criterion = samples * np.log(np.maximum(sum_of_squares, smallest) / samples)
    return int(np.argmin(criterion + penalty * orders * np.log(samples)))
