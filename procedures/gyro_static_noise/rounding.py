"""The noise of counted pulses, which is known: angles rounded while the gyro's noise moves them."""

from __future__ import annotations

import numpy as np

from procedures.estimation.rate_spectrum import variances

from .dataset import Array

WHITE_FROM = 0.4
"""N sqrt(t0) over the pulse from which successive rounding errors are as good as independent."""
MAX_HARMONICS = 400
NOTHING = 1e-12
BLOCKS = 16
"""Parts of a record in which the mean rate decides how roundings follow one another."""
MAX_BEATS = 8
SMEARED = 0.2
"""Cycles per sample over which a harmonic is spread at most to count as a beat."""
FADED = 10.0
"""Widths by which a beat reaches beyond the frequencies that the mean rate takes."""


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


def beats(rate: Array, interval_s: float, pulse: float, walk: float) -> list[tuple[float, float]]:
    """Return the bands in Hz, lowest and highest, where the rounding of a record (n,) beats.

    A harmonic of the sawtooth turns with the fraction of a pulse in a sample, which goes with the
    mean rate of the blocks, and fades as the angle walks.
    """
    blocks = [float(np.mean(block)) for block in np.array_split(rate, BLOCKS)]
    turns = np.array(blocks) * interval_s / pulse
    bands = []
    for harmonic in range(1, MAX_BEATS):
        fading = 2.0 * (np.pi * harmonic * walk / pulse) ** 2 * interval_s
        half = harmonic * float(np.ptp(turns)) + FADED * fading / (2.0 * np.pi) + 2.0 / len(rate)
        if half > SMEARED:
            break
        middle = abs((harmonic * float(np.mean(turns)) + 0.5) % 1.0 - 0.5)
        bands.append(((middle - half) / interval_s, (middle + half) / interval_s))
    return bands
