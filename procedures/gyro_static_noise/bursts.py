"""Blocks of a record that its noise cannot give: shifted for a while, or scattering more.

Held against the noise that was fitted to all records, by a score test over all places and many
lengths. For a shift of length L the data weighted by the inverse covariance are added up over the
window; for scatter the squares of the residuals made white are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import idct

from procedures.estimation.rate_spectrum import coefficients, noise_variances

from .dataset import Array
from .noise_fit import NoiseFit

SHORTEST, LONGEST = 5, 0.05
"""Samples, and part of a record: a longer block is a step or drift, and no burst."""
FINER = 1.4
MAX_BURSTS = 5
MIN_SCATTER = 2.0
"""Of the usual variance: less may be rounding, which is not normal."""
CHANCE = 1e-4
WIDER = 0.2
"""Part of a burst by which it is left out beyond both its ends, which are not sharply seen."""


@dataclass(frozen=True)
class Burst:
    """Samples `first` to `stop` of a record's grid, how much -2 ln L falls, and what it is.

    `shift` in deg/h, or how many times as large the scatter is, 0 for none.
    """

    first: int
    stop: int
    gain: float
    shift: float
    scatter: float


def strongest_burst(
    rate: Array, interval_s: float, noise: NoiseFit, columns: Array
) -> Burst | None:
    """Return the block of a record (n,) that the noise least gives; None without.

    `columns` (n, p) are ramp and lines, of unknown size.
    """
    count = len(rate)
    # A filtered output has the noise of the model only up to a part of its band.
    kept = noise.kept(count, interval_s)
    variance = noise.theta @ noise_variances(count, interval_s)[:, :kept]
    data, design = coefficients(rate - rate.mean())[:kept], coefficients(columns)[:kept]
    weighted = design / variance[:, None]
    data = data - design @ np.linalg.lstsq(weighted.T @ design, weighted.T @ data, rcond=None)[0]
    pulled = _in_time(data / variance, count)
    square = _in_time(data / np.sqrt(variance), count) ** 2
    # Among the samples of a record the usual scatter is taken, so that other misfits do not count.
    square = square / max(float(np.mean(square)), 1e-300)
    sums = np.concatenate(([0.0], np.cumsum(pulled)))
    squares = np.concatenate(([0.0], np.cumsum(square)))
    lengths = _lengths(count)
    needed = 2.0 * np.log(count * max(len(lengths), 1) / CHANCE) * noise.doubled**2
    best: Burst | None = None
    for length in lengths:
        boxcar = np.zeros(count)
        middle = (count - length) // 2
        boxcar[middle : middle + length] = 1.0
        information = float(np.sum(coefficients(boxcar)[:kept] ** 2 / variance))
        total = sums[length:] - sums[:-length]
        scatter = (squares[length:] - squares[:-length]) / length
        wild = (
            length
            * kept
            / count
            * (np.maximum(scatter, 1.0) - 1.0 - np.log(np.maximum(scatter, 1.0)))
        )
        for gains, shifted in ((total**2 / information, True), (wild, False)):
            place = int(np.argmax(gains))
            gain = float(gains[place])
            if gain <= max(needed, best.gain if best else 0.0):
                continue
            if not shifted and scatter[place] < MIN_SCATTER:
                continue
            edge = round(WIDER * length)
            best = Burst(
                max(place - edge, 0),
                min(place + length + edge, count),
                gain,
                float(total[place] / information) if shifted else 0.0,
                0.0 if shifted else float(np.sqrt(scatter[place])),
            )
    return best


def _in_time(values: Array, count: int) -> Array:
    """Return coefficients k = 1.. as a series (count,)."""
    whole = np.zeros(count)
    whole[1 : 1 + len(values)] = values
    return np.asarray(idct(whole, type=2, norm="ortho"))


def _lengths(count: int) -> list[int]:
    """Return the lengths of windows, each `FINER` times the one before."""
    longest = int(LONGEST * count)
    if longest < SHORTEST:
        return []
    steps = int(np.log(longest / SHORTEST) / np.log(FINER)) + 1
    return sorted({round(SHORTEST * FINER**step) for step in range(steps)})
