"""Lines of a record: sines at given frequencies, drift beside them, the published spectrum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .linear import least_squares

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MAX_TURNS = 2**21
"""Phase factors that are in memory at once: 32 MB."""


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


def line_columns(time_s: Array, frequency_Hz: Sequence[float]) -> Array:
    """Return cos and sin of each frequency as columns (n, 2 lines), cos first."""
    angle = 2.0 * np.pi * np.outer(time_s, np.asarray(frequency_Hz, dtype=np.float64))
    columns = np.empty((len(time_s), 2 * angle.shape[1]))
    columns[:, 0::2] = np.cos(angle)
    columns[:, 1::2] = np.sin(angle)
    return columns


def phasors(coefficients: Array) -> Complex:
    """Turn cos, sin coefficients a, c into phasors X = a - j c: x = Re(X exp(2 pi j f t))."""
    return np.asarray(coefficients[0::2] - 1j * coefficients[1::2], dtype=np.complex128)


def averaging_factor(frequency_Hz: float, interval_s: float) -> float:
    """Return sin(pi f t)/(pi f t): what averaging over `interval_s` leaves of a sine."""
    return float(np.sinc(frequency_Hz * interval_s))


def coarse_frequency(time_s: Array, data: Array, start_Hz: float, reach_Hz: float) -> float:
    """Return the strongest frequency within `reach_Hz` of `start_Hz`, to a quarter of 1/T.

    Of a long record the band is first moved to zero and its samples averaged so far that the edges
    of the band turn by an eighth at most in a mean: time and memory then go by the band.
    """
    span_s = float(time_s[-1] - time_s[0])
    # Samples that are far apart in time do not tell more frequencies apart than they are many.
    steps = int(min(np.ceil(4.0 * reach_Hz * span_s), len(time_s)))
    grid = start_Hz + np.arange(-steps, steps + 1) * (reach_Hz / max(steps, 1))
    grid = grid[grid > 0.25 / span_s]
    if len(grid) == 0:
        return start_Hz
    moved: Array | Complex = data - np.mean(data)
    origin_Hz, together = 0.0, 1
    if len(grid) * len(time_s) > _MAX_TURNS:
        together = max(int(len(time_s) / (8.0 * reach_Hz * span_s)), 1)
    if together > 1:
        origin_Hz = start_Hz
        whole = len(time_s) - len(time_s) % together
        turned = moved * np.exp(-2j * np.pi * start_Hz * time_s)
        moved = turned[:whole].reshape(-1, together).mean(axis=1)
        time_s = time_s[:whole].reshape(-1, together).mean(axis=1)
    rows = max(_MAX_TURNS // len(time_s), 1)
    power = np.empty(len(grid))
    for first in range(0, len(grid), rows):
        part = slice(first, first + rows)
        turns = np.exp(-2j * np.pi * np.outer(grid[part] - origin_Hz, time_s))
        power[part] = np.abs(np.einsum("ij,j->i", turns, moved))
    return float(grid[int(np.argmax(power))])


def refine_frequency(
    time_s: Array, data: Array, frequency_Hz: Sequence[float], line: int, drift_order: int
) -> tuple[float, float]:
    """Fit the frequency of one line of a record and return it with its standard uncertainty.

    The four-parameter sine fit (IEEE Std 1057) with drift and the other lines beside it:
    Gauss-Newton, the linear parameters solved anew at each step. Origin of time in the middle of
    the record, where frequency and phase are not correlated.
    """
    middle_s = 0.5 * float(time_s[0] + time_s[-1])
    half_s = 0.5 * float(time_s[-1] - time_s[0])
    moved = time_s - middle_s
    drift = legendre_columns(moved, drift_order, -half_s, half_s)
    others = line_columns(moved, [f for k, f in enumerate(frequency_Hz) if k != line])
    fixed = np.hstack((drift, others))
    frequency = float(frequency_Hz[line])
    uncertainty = 0.0
    amplitudes: Array | None = None
    for _ in range(8):
        pair = line_columns(moved, [frequency])
        if amplitudes is None:
            amplitudes = least_squares(np.hstack((pair, fixed)), data).coefficients[:2]
        slope = (moved / half_s) * (amplitudes[1] * pair[:, 0] - amplitudes[0] * pair[:, 1])
        size = float(np.hypot(*amplitudes))
        if size == 0.0:
            break
        fit = least_squares(np.column_stack((slope / size, pair, fixed)), data)
        step = float(fit.coefficients[0]) / size / (2.0 * np.pi * half_s)
        # A quarter of a line per step: beyond that the linearisation means nothing.
        limit = 0.125 / half_s
        step = min(max(step, -limit), limit)
        frequency += step
        amplitudes = fit.coefficients[1:3]
        freedom = max(len(data) - fixed.shape[1] - 3, 1)
        sigma = np.sqrt(fit.sum_of_squares / freedom * fit.inverse_normal[0, 0])
        uncertainty = float(sigma) / size / (2.0 * np.pi * half_s)
        if abs(step) * half_s < 1e-9:
            break
    return frequency, uncertainty


def amplitude_spectrum(samples: Array, interval_s: float) -> tuple[Array, Array]:
    """Return frequencies k/T in Hz and amplitudes 2|X[k]|/N, for k = 0..N/2.

    X[k] = sum x[n] exp(-2 pi j k n / N). The published ordinate doubles every line; the two lines
    that have no mirror image (k = 0 and k = N/2) are not doubled here, and the axis ends at N/2,
    where the mirror images begin.
    """
    count = len(samples)
    amplitudes = 2.0 * np.abs(np.fft.rfft(samples)) / count
    amplitudes[0] *= 0.5
    if count % 2 == 0:
        amplitudes[-1] *= 0.5
    return np.arange(len(amplitudes)) / (count * interval_s), amplitudes


def nearest_lines(samples: int, interval_s: float, wanted_Hz: float) -> range:
    """Return the k of the line nearest to `wanted_Hz` and its two neighbours.

    Empty where that line is not on the axis or is the mean; the mean (k = 0) is never among them.
    """
    top = samples // 2
    nearest = int(np.floor(wanted_Hz * samples * interval_s + 0.5))
    if samples < 4 or nearest < 1 or nearest > top:
        return range(0)
    return range(max(nearest - 1, 1), min(nearest + 1, top) + 1)


class LineSums:
    """The amplitudes of some lines of a long record's spectrum, summed up piece by piece."""

    def __init__(self, samples: int, lines: Sequence[int]) -> None:
        self._samples = samples
        self._lines = lines
        self._sums = np.zeros(len(lines), dtype=np.complex128)
        self._counted = 0

    def add(self, samples: Array) -> None:
        """Take the next samples of the record."""
        places = np.arange(self._counted, self._counted + len(samples), dtype=np.int64)
        for number, k in enumerate(self._lines):
            turn = (places * k % self._samples) * (-2.0 * np.pi / self._samples)
            self._sums[number] += complex(
                np.einsum("i,i->", samples, np.cos(turn)), np.einsum("i,i->", samples, np.sin(turn))
            )
        self._counted += len(samples)

    def peak(self) -> float | None:
        """Return the largest amplitude 2|X[k]|/N; None where there is no line or no whole record.

        The line k = N/2 is not doubled.
        """
        if not len(self._lines) or self._counted != self._samples:
            return None
        whole = np.array([1.0 if 2 * k == self._samples else 2.0 for k in self._lines])
        return float(np.max(whole * np.abs(self._sums)) / self._samples)


def peak_near(frequency_Hz: Array, amplitude: Array, wanted_Hz: float) -> float | None:
    """Return the largest amplitude on the line nearest to `wanted_Hz` and its two neighbours.

    None when that line is not on the axis or is the mean. The mean (k = 0) is never a candidate.
    """
    if len(frequency_Hz) < 3:
        return None
    nearest = int(np.floor(wanted_Hz / frequency_Hz[1] + 0.5))
    if nearest < 1 or nearest > len(amplitude) - 1:
        return None
    return float(np.max(amplitude[max(nearest - 1, 1) : nearest + 2]))
