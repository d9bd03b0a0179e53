"""Blocks of a record that its noise cannot give: shifted for a while, or scattering more.

Held against the noise that was fitted to all records, by a score test over all places and many
lengths. For a shift of length L the data weighted by the inverse covariance are added up over the
window; for scatter the squares of the residuals made white are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.rate_spectrum import coefficients, noise_variances

from .dataset import Array, Record
from .gaps import bridged, pieces
from .noise import SAWTOOTH_U, NoiseFit, in_time

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
    """A block that is left out: `shift` in deg/h, or how many times as large the scatter is.

    `first` to `stop` are its samples on the grid of a piece, `gain` is how much -2 ln L falls.
    `count` samples from `begin_s` to `end_s` after power-on of `switch_on` are lost by it.
    """

    first: int
    stop: int
    gain: float
    shift: float = 0.0
    scatter: float = 0.0
    switch_on: int = 0
    begin_s: float = 0.0
    end_s: float = 0.0
    count: int = 0


def without_bursts(
    records: Sequence[Record], grids: Sequence[Array], noise: NoiseFit
) -> tuple[list[Array], list[Burst]]:
    """Return the records on their grids with NaN in bursts, and these."""
    kept, bursts = [], []
    for record, grid in zip(records, grids, strict=True):
        rate = grid.copy()
        for piece in pieces(rate):
            for _ in range(MAX_BURSTS):
                burst = strongest_burst(piece, noise)
                if burst is None:
                    break
                before = np.isfinite(rate)
                piece[burst.first : burst.stop] = np.nan  # a view of `rate`
                lost = np.flatnonzero(before & ~np.isfinite(rate))
                if not len(lost):
                    break
                begin_s, end_s = float(record.time_s[0]) + noise.known.interval_s * lost[[0, -1]]
                where = {"begin_s": begin_s, "end_s": end_s, "count": len(lost)}
                bursts.append(replace(burst, switch_on=record.switch_on, **where))
        kept.append(rate)
    return kept, bursts


def strongest_burst(piece: Array, noise: NoiseFit) -> Burst | None:
    """Return the block of a record (n,), NaN in gaps, that the noise least gives; None without."""
    count, interval_s = len(piece), noise.known.interval_s
    rate = bridged(piece, interval_s, noise.theta, 0.0)
    # A filtered output has the noise of the model only up to a part of its band.
    kept = noise.known.kept(count)
    variance = noise.theta @ noise_variances(count, interval_s)[:, :kept]
    data = coefficients(rate - rate.mean())[:kept]
    design = coefficients(noise.columns(count))[:kept]
    weighted = design / variance[:, None]
    data = data - design @ np.linalg.lstsq(weighted.T @ design, weighted.T @ data, rcond=None)[0]
    square = in_time(data / np.sqrt(variance), count) ** 2
    # Among the samples of a record the usual scatter is taken, so that other misfits do not count.
    square = square / max(float(np.mean(square)), 1e-300)
    sums = np.concatenate(([0.0], np.cumsum(in_time(data / variance, count))))
    squares = np.concatenate(([0.0], np.cumsum(square)))
    steps = np.arange(0.0, np.log(max(LONGEST * count / SHORTEST, 1e-9)), np.log(FINER))
    lengths = np.unique(np.rint(SHORTEST * np.exp(steps)).astype(int)).tolist()
    needed = 2.0 * np.log(count * max(len(lengths), 1) / CHANCE)
    needed *= SAWTOOTH_U**2 if noise.sawtooth else 1.0
    best: Burst | None = None
    for length in lengths:
        boxcar = np.zeros(count)
        boxcar[(count - length) // 2 :][:length] = 1.0
        information = float(np.sum(coefficients(boxcar)[:kept] ** 2 / variance))
        total = sums[length:] - sums[:-length]
        scatter = (squares[length:] - squares[:-length]) / length
        more = np.where(scatter > MIN_SCATTER, scatter, 1.0)
        wild = length * kept / count * (more - 1.0 - np.log(more))
        for gains, shifted in ((total**2 / information, True), (wild, False)):
            place = int(np.argmax(gains))
            gain = float(gains[place])
            if gain <= max(needed, best.gain if best else 0.0):
                continue
            edge = round(WIDER * length)
            best = Burst(max(place - edge, 0), min(place + length + edge, count), gain)
            if shifted:
                best = replace(best, shift=float(total[place] / information))
            else:
                best = replace(best, scatter=float(np.sqrt(scatter[place])))
    return best
