"""Coloured noise: autoregressive whitening across gaps, and the noise density next to a line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.special import fdtri

from .linear import Columns, Rows

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NEAR = 16
WIDE = 96


def grid_index(time_s: Array, interval_s: float) -> Index:
    """Number the samples on the nominal grid, so that missing rows leave missing numbers.

    Steps are rounded one by one: a sample clock that is some ppm off never slips a number.
    """
    steps = np.maximum(np.rint(np.diff(time_s) / interval_s), 1.0)
    return np.concatenate(([0], np.cumsum(steps))).astype(np.int64)


@dataclass(frozen=True)
class Autoregression:
    """Prediction coefficients of all orders 0..p (row m predicts from m values) and their errors.

    `coefficients[m, k]` multiplies the value k + 1 steps back; `variances[m]` is the variance of
    what order m leaves, relative to the variance of the series.
    """

    coefficients: Array
    variances: Array

    @property
    def order(self) -> int:
        """The order p."""
        return len(self.variances) - 1


def fit_autoregression(residuals: Array, index: Index, max_order: int) -> Autoregression:
    """Fit an autoregression by Yule-Walker, order 0..max_order by BIC.

    `residuals` (n,) sit at grid places `index`; missing places count as zero in the lagged sums,
    which keeps the sequence positive definite whatever is missing.
    """
    samples = len(residuals)
    series = np.zeros(int(index[-1]) + 1)
    series[index] = residuals
    covariance = np.array(
        [
            np.einsum("i,i->", series[: len(series) - k], series[k:])
            for k in range(min(max_order, len(series) - 1) + 1)
        ]
    )
    if covariance[0] <= 0.0:
        return Autoregression(np.zeros((1, 0)), np.ones(1))
    covariance /= covariance[0]
    rows, variances = _levinson(covariance)
    criterion = samples * np.log(variances) + np.arange(len(variances)) * np.log(samples)
    order = int(np.argmin(criterion))
    return Autoregression(rows[: order + 1, :order], variances[: order + 1])


def _levinson(covariance: Array) -> tuple[Array, Array]:
    top = len(covariance) - 1
    rows = np.zeros((top + 1, top))
    variances = np.ones(top + 1)
    for m in range(1, top + 1):
        past = rows[m - 1, : m - 1]
        reflection = (covariance[m] - past @ covariance[m - 1 : 0 : -1]) / variances[m - 1]
        rows[m, : m - 1] = past - reflection * past[::-1]
        rows[m, m - 1] = reflection
        variances[m] = variances[m - 1] * max(1.0 - reflection**2, 1e-12)
    return rows, variances


def whiten(columns: Array, index: Index, model: Autoregression) -> Array:
    """Whiten the columns (n, k) of a series that sits at grid places `index`.

    Exact for the stationary autoregression: the first samples of each unbroken stretch are
    predicted from as many values as there are, so that a gap costs no sample.
    """
    if model.order == 0:
        return columns
    breaks = np.flatnonzero(np.diff(index) != 1) + 1
    starts = np.concatenate(([0], breaks))
    lengths = np.diff(np.concatenate((starts, [len(index)])))
    place = np.arange(len(index)) - np.repeat(starts, lengths)
    order = np.minimum(place, model.order)
    weights = model.coefficients[order]
    result = columns.copy()
    for k in range(1, model.order + 1):
        result[k:] -= weights[k:, k - 1, None] * columns[:-k]
    result /= np.sqrt(model.variances[order])[:, None]
    return result


def whitened(columns: Columns, index: Index, model: Autoregression) -> Columns:
    """Return columns whitened as `whiten` does it, a block of rows at a time."""

    def make(rows: Rows) -> Array:
        first, last, _ = cast(slice, rows).indices(columns.rows)
        before = max(first - model.order, 0)
        wide = slice(before, last)
        return whiten(columns.at(wide), index[wide], model)[first - before :]

    return Columns(columns.rows, make)


@dataclass(frozen=True)
class Periodogram:
    """Ordinates |sum r exp(-2 pi j f t)|^2 / n of residuals: the noise variance per sample at f."""

    frequency_Hz: Array
    ordinate: Array
    span_s: float


def periodogram(residuals: Array, index: Index, interval_s: float) -> Periodogram:
    """Return the periodogram of residuals (n,) on a grid, at twice the natural resolution."""
    places = int(index[-1]) + 1
    length = int(next_fast_len(2 * places, real=True))
    series = np.zeros(length)
    series[index] = residuals
    ordinate = np.abs(rfft(series)) ** 2 / len(residuals)
    frequency_Hz = np.arange(len(ordinate)) / (length * interval_s)
    return Periodogram(frequency_Hz, ordinate, places * interval_s)


@dataclass(frozen=True)
class LocalNoise:
    """Mean periodogram ordinate next to a line (a variance per sample) and its freedom."""

    variance: float
    degrees_of_freedom: float


def local_noise(
    spectrum: Periodogram,
    frequency_Hz: float,
    occupied_Hz: Sequence[float],
    lowest_Hz: float,
    highest_Hz: float,
    half_bins: int,
) -> LocalNoise | None:
    """Return the noise density around a line from the residuals' periodogram.

    Takes the nearest `half_bins` ordinates outside +-1.5/T of the line, away (1/T) from the
    `occupied_Hz` lines that the fit has emptied, within lowest..highest. None when there are fewer
    than half of those or fewer than four. Neighbouring ordinates at half the natural spacing share
    much of their content: the degrees of freedom count that.
    """
    place = spectrum.frequency_Hz
    allowed = (place >= lowest_Hz) & (place <= highest_Hz)
    allowed &= np.abs(place - frequency_Hz) * spectrum.span_s > 1.5
    for line in occupied_Hz:
        allowed &= np.abs(place - line) * spectrum.span_s > 1.0
    candidates = np.flatnonzero(allowed)
    if len(candidates) < max(4, half_bins // 2):
        return None
    nearest = np.argsort(np.abs(place[candidates] - frequency_Hz), kind="stable")[:half_bins]
    chosen = candidates[nearest]
    apart = (place[chosen][:, None] - place[chosen][None, :]) * spectrum.span_s
    freedom = 2.0 * len(chosen) ** 2 / float((np.sinc(apart) ** 2).sum())
    return LocalNoise(float(spectrum.ordinate[chosen].mean()), freedom)


def noise_near_line(
    spectrum: Periodogram,
    frequency_Hz: float,
    occupied_Hz: Sequence[float],
    lowest_Hz: float,
    highest_Hz: float,
    overall: LocalNoise,
    coloured: bool = False,
) -> LocalNoise:
    """Return the noise at a line from the widest band that agrees with what is near the line.

    Few ordinates next to the line are true to its place but scatter by a third; the whole record is
    precise but may have another colour. The whole record (`overall`) is believed when a band of
    96 ordinates agrees with it (F test, 5 % on each side) and the record was not `coloured` before
    it was whitened: an autoregression of low order is a poor likeness of counted pulses. Failing
    that, that band when the nearest 16 agree with it (1 % on each side); else the nearest 16.
    """
    near = local_noise(spectrum, frequency_Hz, occupied_Hz, lowest_Hz, highest_Hz, NEAR)
    wide = local_noise(spectrum, frequency_Hz, occupied_Hz, lowest_Hz, highest_Hz, WIDE)
    if near is None:
        return overall if wide is None or _agree(wide, overall, 0.05) else wide
    if wide is None:
        return overall if _agree(near, overall, 0.01) else near
    if not _agree(near, wide, 0.01):
        return near
    return overall if not coloured and _agree(wide, overall, 0.05) else wide


def _agree(local_noise: LocalNoise, other: LocalNoise, chance: float) -> bool:
    if other.variance <= 0.0:
        return True
    ratio = local_noise.variance / other.variance
    freedoms = local_noise.degrees_of_freedom, other.degrees_of_freedom
    return bool(fdtri(*freedoms, chance) <= ratio <= fdtri(*freedoms, 1.0 - chance))


def lag_one_correlation(residuals: Array, index: Index) -> float:
    """Return the correlation of residuals one grid step apart (0 when there are no such pairs)."""
    pairs = np.flatnonzero(np.diff(index) == 1)
    power = float(residuals @ residuals)
    if len(pairs) < 2 or power <= 0.0:
        return 0.0
    products = float(residuals[pairs] @ residuals[pairs + 1])
    return products / len(pairs) / (power / len(residuals))
