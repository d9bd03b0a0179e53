"""What the bias follows: a temperature that lags, its rate, and where it came from."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from .dataset import Array

SECONDS_PER_MINUTE = 60.0
SHORTEST = 1e-3
"""A lag below this part of an interval is none."""
HALF = 2
"""Rows to either side over which a rate of temperature is taken."""


def lagged(values: Array, lag_s: float, interval_s: float) -> Array:
    """Return values (n,) behind a first-order lag, at rest before the first of them."""
    if lag_s <= SHORTEST * interval_s:
        return values.copy()
    # Between the middles of two intervals the values go in a straight line: no half interval late.
    width = interval_s / lag_s
    kept = float(np.exp(-width))
    share = (1.0 - kept) / width
    now, before = 1.0 - share, share - kept
    # The filter's state at rest at the first value.
    first = [(before + kept) * values[0]]
    return np.asarray(lfilter([now, before], [1.0, -kept], values, zi=first)[0])


def rate_per_minute(values: Array, interval_s: float) -> Array:
    """Return the rate of change (n,) of values a minute, over two rows to either side."""
    place = np.arange(len(values))
    before, after = np.maximum(place - HALF, 0), np.minimum(place + HALF, len(values) - 1)
    steps = (after - before) * interval_s / SECONDS_PER_MINUTE
    return np.asarray((values[after] - values[before]) / steps)


def loop(values: Array, half_width: float) -> Array:
    """Return where values (n,) stand in a loop, -1 after cooling to +1 after warming.

    A play of a half width in the unit of the values; zero where it begins.
    """
    slack = np.empty_like(values)
    held = float(values[0])
    for row, value in enumerate(values.tolist()):
        held = min(max(held, value - half_width), value + half_width)
        slack[row] = held
    return np.asarray((values - slack) / half_width)
