"""Sines of known frequency, and the frequency of a sine found in its own record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .drift import legendre_columns
from .linear import least_squares

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MOST_TURNS = 2**21
"""Phase factors that are in memory at once: 32 MB."""


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
    if len(grid) * len(time_s) > _MOST_TURNS:
        together = max(int(len(time_s) / (8.0 * reach_Hz * span_s)), 1)
    if together > 1:
        origin_Hz = start_Hz
        whole = len(time_s) - len(time_s) % together
        turned = moved * np.exp(-2j * np.pi * start_Hz * time_s)
        moved = turned[:whole].reshape(-1, together).mean(axis=1)
        time_s = time_s[:whole].reshape(-1, together).mean(axis=1)
    rows = max(_MOST_TURNS // len(time_s), 1)
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
