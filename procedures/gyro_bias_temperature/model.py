"""What the bias follows, a temperature that lags, its rate and a loop; the columns of the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.signal import lfilter

from .dataset import Array

SECONDS_PER_MINUTE = 60.0
SHORTEST = 1e-3
"""A lag below this part of an interval is none."""
HALF = 2
"""Rows to either side over which a rate of temperature is taken."""
INNER_PRIOR_S = 300.0
"""Standard uncertainty of the lag within a gyro that has no thermometer, as it is of others."""
MIN_LAG = 0.01
"""Of an interval: what is known of a lag beforehand where it is stated to be none."""

Lags = tuple[float, ...]
"""The whole lag of Te in s and, behind a chamber, the part of it that is within the gyro."""


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
    low, high = values - half_width, values + half_width
    # Each row clips what was held before; two clips in a row are one, so all are joined in pairs.
    step = 1
    while step < len(values):
        ends = [np.clip(own[:-step], low[step:], high[step:]) for own in (low, high)]
        low[step:], high[step:] = ends
        step *= 2
    return np.asarray((values - np.clip(values[0], low, high)) / half_width)


@dataclass(frozen=True)
class Setting:
    """Temperature (n,) on the grid of the rows, what is known beforehand, and what is asked for.

    `lag_prior_s` is that of the gyro's own thermometer, None where the chamber's is the only one;
    `switched` (n, m) has a column of zero mean for each switch-on after the first, whose bias is
    another; `step` what a reading of the output is rounded to, in deg/h.
    """

    temperature: Array
    interval_s: float
    lag_prior_s: float | None
    has_loop: bool
    switched: Array
    step: float = 0.0

    @property
    def priors_s(self) -> Array:
        """The standard uncertainties of the lags that are known beforehand."""
        if self.lag_prior_s is None:
            return np.array([np.inf, INNER_PRIOR_S])
        return np.array([max(self.lag_prior_s, MIN_LAG * self.interval_s)])

    @property
    def domain(self) -> tuple[float, float]:
        """The lowest and highest temperature."""
        return float(self.temperature.min()), float(self.temperature.max())

    def scaled(self, temperature: Array) -> Array:
        """Return temperatures on the curve's domain, -1 to 1."""
        low, high = self.domain
        return np.asarray((2.0 * temperature - low - high) / (high - low))

    def columns(self, order: int, lags_s: Lags, width: float) -> Array:
        """Return the model's columns (n, p): polynomials 1..order, rate, half loop, switch-ons."""
        own = self.temperature
        if self.lag_prior_s is None:
            own = lagged(own, lags_s[0] - lags_s[1], self.interval_s)
        effective = lagged(own, lags_s[-1], self.interval_s)
        curve = chebyshev.chebvander(self.scaled(effective), order)[:, 1:]
        parts = [curve, rate_per_minute(own, self.interval_s)[:, None]]
        if self.has_loop:
            parts.append(0.5 * loop(effective, width)[:, None])
        return np.column_stack([*parts, self.switched])
