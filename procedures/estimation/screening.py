"""What of a record at rest is no output: wild, frozen and saturated samples, and gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from procedures.estimation.linear import robust_sigma
from procedures.estimation.noise import grid_index

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

AROUND = 31
"""Samples whose median a sample is held against."""
MAX_RUN = 20
FAR = 8.0
LONG_GAP, MAX_GAP = 0.02, 300
"""Part of a record, and samples, that a gap may be to be bridged; a longer one divides it."""


@dataclass(frozen=True)
class Screened:
    """One axis of one record on its grid: `rate` (n,), NaN where nothing is; how many were what."""

    rate: Array
    wild: int
    frozen: int
    saturated: int

    @property
    def there(self) -> Array:
        """The good samples alone."""
        return self.rate[np.isfinite(self.rate)]

    def pieces(self) -> list[Array]:
        """Return the parts between gaps that are too long to be bridged, none of them empty."""
        good = np.flatnonzero(np.isfinite(self.rate))
        if not len(good):
            return []
        longest = min(MAX_GAP, max(1.0, LONG_GAP * len(self.rate)))
        cuts = np.flatnonzero(np.diff(good) - 1 > longest)
        firsts, lasts = good[np.r_[0, cuts + 1]], good[np.r_[cuts, len(good) - 1]]
        return [self.rate[a : b + 1] for a, b in zip(firsts, lasts, strict=True)]


def screen(
    time_s: Array, rate: Array, interval_s: float, quantum: float, beyond: float
) -> Screened:
    """Return one axis of a record with what is no output taken away.

    `quantum` is one count as a rate: a sample may lie one count farther than noise alone, since
    rounded samples do. `beyond` is in robust standard deviations.
    """
    index = grid_index(time_s, interval_s)
    step = max(quantum, smallest_step(rate))
    frozen = _runs(rate, step)
    good = ~frozen
    outermost = saturated = np.zeros(len(rate), dtype=bool)
    wild = outermost.copy()
    if good.sum() > AROUND:
        kept = rate[good]
        centre = median_filter(kept, AROUND, mode="nearest")
        sigma = robust_sigma(kept - centre, 0.3 * step)
        wild[good] = np.abs(kept - centre) > beyond * sigma + step
        saturated = frozen & (np.abs(rate - np.median(kept)) > FAR * sigma + step)
    values = np.full(int(index[-1]) + 1, np.nan)
    use = good & ~wild
    values[index[use]] = rate[use]
    return Screened(values, int(wild.sum()), int((frozen & ~saturated).sum()), int(saturated.sum()))


def smallest_step(rate: Array) -> float:
    """Return the resolution of an output: the smallest difference of two of its values."""
    levels = np.unique(rate)
    steps = np.diff(levels)
    steps = steps[steps > 1e-12 * max(1.0, float(np.abs(levels).max()))]
    return float(steps.min()) if len(steps) else 0.0


def is_coarse(rate: Array, step: float) -> bool:
    """Return whether the noise hardly moves the output from one of its steps to the next."""
    return bool(step > 0.0 and float(np.std(np.diff(rate))) < np.sqrt(2.0) * step)


def _runs(rate: Array, step: float) -> Mask:
    """Return which samples stand in a run of equal ones longer than chance lets them be."""
    count = len(rate)
    starts = np.flatnonzero(np.r_[True, rate[1:] != rate[:-1]])
    lengths = np.diff(np.r_[starts, count])
    equal = float(np.mean(rate[1:] == rate[:-1])) if count > 1 else 0.0
    longest = MAX_RUN
    if len(starts) > 1 and 0.0 < equal < 1.0:
        # Among short runs: how often a sample equals the one before it, without frozen stretches.
        short = lengths <= np.percentile(lengths, 99)
        equal = 1.0 - float(short.sum() / max(lengths[short].sum(), 1))
        if equal > 0.0:
            longest = max(longest, int(np.ceil(2.0 * np.log(count) / -np.log(min(equal, 0.999)))))
    return np.repeat(lengths > longest, lengths)


def gaps(rate: Array) -> list[tuple[int, int]]:
    """Return first and last place of each gap within a record on its grid."""
    missing: Index = np.flatnonzero(~np.isfinite(rate))
    if not len(missing):
        return []
    cuts = np.flatnonzero(np.diff(missing) > 1)
    firsts, lasts = missing[np.r_[0, cuts + 1]], missing[np.r_[cuts, len(missing) - 1]]
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True)]
