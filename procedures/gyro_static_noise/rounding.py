"""The noise of counted pulses, which is known: angles rounded while the gyro's noise moves them."""

from __future__ import annotations

import numpy as np

from procedures.estimation.rate_spectrum import variances

from .dataset import Array

WHITE_FROM = 0.4
"""N sqrt(t0) over the pulse from which successive rounding errors are as good as independent."""
MAX_HARMONICS = 400
NOTHING = 1e-12


def rounding_covariance(
    count: int, interval_s: float, pulse: float, walk: float, mean_rates: Array
) -> Array:
    """Return the covariances (n,) of the rate errors that rounding to whole pulses makes.

    `pulse` in arcsec, `walk` N in deg/h sqrt(s), `mean_rates` (b,) in deg/h as the gyro sees
    them, block by block. The error of an angle is a sawtooth of it; each harmonic turns with the
    mean rate and fades as the angle walks. Where the rate drifts, the mean over the blocks counts.
    """
    lag = np.arange(count + 1)
    angle = np.zeros(count + 1)
    angle[0] = pulse**2 / 12.0
    fading = 2.0 * (np.pi * walk / pulse) ** 2 * interval_s
    turning = 2.0 * np.pi * ((mean_rates * interval_s / pulse) % 1.0)
    for harmonic in range(1, MAX_HARMONICS):
        fade = fading * harmonic**2
        if fade > -np.log(NOTHING):
            break
        reach = count + 1 if fade <= 0.0 else min(count + 1, int(-np.log(NOTHING) / fade) + 1)
        own = lag[1:reach]
        size = pulse**2 / (2.0 * (np.pi * harmonic) ** 2)
        turned = np.mean([np.cos(harmonic * rate * own) for rate in turning], axis=0)
        angle[1:reach] += size * np.exp(-fade * own) * turned
    before = np.abs(lag[:count] - 1)
    second = 2.0 * angle[:count] - angle[1:] - angle[before]
    return np.asarray(second / interval_s**2)


def rounding_variances(
    count: int, interval_s: float, pulse: float, walk: float, mean_rates: Array
) -> Array:
    """Return the variances (n - 1,) that rounding adds to the coefficients of a record."""
    if pulse <= 0.0:
        return np.zeros(count - 1)
    known = rounding_covariance(count, interval_s, pulse, walk, mean_rates)
    return np.maximum(variances(known), 0.0)
