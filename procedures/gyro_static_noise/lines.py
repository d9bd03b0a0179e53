"""Periodic lines in a record at rest: the air conditioning, the gyro's dither, a neighbour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import idct, next_fast_len, rfft
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from procedures.estimation.rate_spectrum import coefficients
from procedures.estimation.reml import Components, Solved

from .dataset import Array

FEWEST_CYCLES = 2.0
WORTH_A_TRY = 12.0
"""Fall of -2 ln L, noise not fitted again, below which a line cannot be one."""
FINER = 2
AROUND, USUAL_FALL = 201, 2.0 * np.log(2.0)
"""Frequencies whose median fall a line is held against, and that of noise."""
ALONE = 40.0
"""Fall, over that of its neighbours, of a line in an output of roundings."""


@dataclass(frozen=True)
class Line:
    """A line of the rate: its frequency, and its amplitude, root mean square over the records."""

    frequency_Hz: float
    amplitude_deg_per_h: float

    @classmethod
    def of(cls, frequency_Hz: float, sizes: Sequence[Array], interval_s: float) -> Line:
        """Return a line from its cosine and sine in each record; interval means are corrected."""
        mean = float(np.sqrt(np.mean([size @ size for size in sizes])))
        return cls(frequency_Hz, mean / float(np.sinc(frequency_Hz * interval_s)))


def line_columns(time_s: Array, frequencies_Hz: Sequence[float]) -> list[Array]:
    """Return cosine and sine (n,) of each frequency."""
    angles = [2.0 * np.pi * frequency_Hz * time_s for frequency_Hz in frequencies_Hz]
    return [part(angle) for angle in angles for part in (np.cos, np.sin)]


def centred_times(count: int, interval_s: float) -> Array:
    """Return the times (n,) of a record's samples from its middle."""
    return np.asarray((np.arange(count) - 0.5 * (count - 1)) * interval_s, dtype=np.float64)


def strongest_line(
    best: Components,
    interval_s: float,
    counts: Sequence[int],
    known: Sequence[Sequence[tuple[float, float]]] = (),
) -> float | None:
    """Return the frequency in Hz that lowers -2 ln L most; None where none is worth a try.

    Looked for in the residuals made white, then refined with the noise as it is. What beats in the
    `known` bands, in Hz, of any record is its rounding.
    """
    length = next_fast_len(FINER * max(counts), real=True)
    falls = np.zeros(length // 2 + 1)
    for solved, count in zip(best.solved, counts, strict=True):
        white = np.zeros(count)
        white[1 : 1 + len(solved.residuals)] = solved.residuals / np.sqrt(solved.variance)
        falls += 2.0 * np.abs(rfft(idct(white, type=2, norm="ortho"), length)) ** 2 / count
    frequency = np.arange(len(falls)) / (length * interval_s)
    span_s = max(counts) * interval_s
    falls[frequency < FEWEST_CYCLES / span_s] = 0.0
    if known:
        # What rounding leaves beside its bands is no line: it lifts its neighbours, too.
        usual = median_filter(falls, AROUND, mode="nearest") / USUAL_FALL
        falls = falls / np.maximum(usual, 1.0)
    for low_Hz, high_Hz in (band for bands in known for band in bands):
        falls[(frequency >= low_Hz) & (frequency <= high_Hz)] = 0.0
    top = int(np.argmax(falls))
    if falls[top] < (ALONE if known else WORTH_A_TRY):
        return None

    def kept(frequency_Hz: float) -> float:
        return -sum(
            _fall(solved, frequency_Hz, interval_s, count)
            for solved, count in zip(best.solved, counts, strict=True)
        )

    reach = 1.0 / (FINER * span_s)
    bounds = (max(frequency[top] - reach, FEWEST_CYCLES / span_s), frequency[top] + reach)
    return float(minimize_scalar(kept, bounds=bounds, method="bounded").x)


def _fall(solved: Solved, frequency_Hz: float, interval_s: float, count: int) -> float:
    """Return by how much a line lowers -2 ln L of one record with its noise as it is."""
    variance, residuals = solved.variance, solved.residuals
    time_s = centred_times(count, interval_s)
    pair = coefficients(np.column_stack(line_columns(time_s, [frequency_Hz])))[: len(residuals)]
    weighted = pair / variance[:, None]
    explained = weighted.T @ residuals
    return float(explained @ np.linalg.solve(weighted.T @ pair, explained))
