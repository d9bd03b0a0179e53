"""Gaps of a record bridged by what its noise lets stand there.

A missing sample is drawn from its distribution given its neighbours: the best prediction and noise
of the right size. A mere interpolation would be too smooth, and cut the anticorrelation of rounded
angles, which then passes for white noise.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import toeplitz

from procedures.estimation.rate_spectrum import covariances

from .dataset import Array

AROUND = 40
"""Samples on either side that a gap is predicted from."""
LONG_GAP, MAX_GAP = 0.02, 300
"""Part of a record, and samples, that a gap may be to be bridged; a longer one divides it."""


def pieces(rate: Array) -> list[Array]:
    """Return the parts of a record on its grid between gaps too long to be bridged, none empty."""
    longest = min(MAX_GAP, max(1.0, LONG_GAP * len(rate)))
    good = np.flatnonzero(np.isfinite(rate))
    parts = np.split(good, np.flatnonzero(np.diff(good) - 1 > longest) + 1)
    return [rate[part[0] : part[-1] + 1] for part in parts if len(part)]


def bridged(rate: Array, interval_s: float, theta: Array, pulse_arcsec: float) -> Array:
    """Return a record (n,) with its gaps, NaN, filled; `theta` holds the squares of Q, N, B, K.

    The draw is the same each time, so that results repeat.
    """
    filled = rate.copy()
    random = np.random.default_rng(0)
    squares = theta + np.array([pulse_arcsec**2 / 12.0, 0.0, 0.0, 0.0])
    missing = np.flatnonzero(~np.isfinite(rate))
    for gap in np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1) if len(missing) else ():
        low, high = max(gap[0] - AROUND, 0), min(gap[-1] + AROUND + 1, len(rate))
        places = np.arange(low, high)
        known = np.isfinite(filled[places])
        covariance = toeplitz(squares @ covariances(len(places), interval_s))
        filled[places[~known]] = _drawn(covariance, filled[places], known, random)
    return filled


def _drawn(
    covariance: Array, values: Array, known: np.ndarray, random: np.random.Generator
) -> Array:
    """Return the unknown values given the known ones about a mean that nobody knows."""
    count = int(known.sum())
    system = np.ones((count + 1, count + 1))
    system[:count, :count] = covariance[np.ix_(known, known)]
    system[count, count] = 0.0
    towards = np.ones((count + 1, len(values) - count))
    towards[:count] = covariance[np.ix_(known, ~known)]
    weights = np.linalg.solve(system, towards)
    expected = weights[:count].T @ values[known]
    left = covariance[np.ix_(~known, ~known)] - weights.T @ towards
    size, shape = np.linalg.eigh(0.5 * (left + left.T))
    noise = random.standard_normal(len(size))
    return np.asarray(expected + shape @ (np.sqrt(np.maximum(size, 0.0)) * noise))
