"""Variances of the cosine coefficients of a rate record, for each kind of gyro noise.

A record of n means over an interval t0 is turned into the coefficients k = 1..n-1 of its
orthonormal DCT-II. They do not hold the mean, and for noise with stationary increments they are so
nearly independent that their variances say all. Rates are in deg/h = arcsec/s, times in s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct, rfft

Array = NDArray[np.float64]

KINDS = ("Q", "N", "B", "K")
"""Quantisation, angle random walk, bias instability, rate random walk; their squares add up."""
FLICKER = 2.0 * np.log(2.0) / np.pi
SERIES_FROM = 100


def coefficients(rate: Array) -> Array:
    """Return the coefficients k = 1..n-1 of a record or of columns, (n, ...) to (n - 1, ...)."""
    return np.asarray(dct(rate, type=2, norm="ortho", axis=0)[1:])


def in_time(values: Array, count: int) -> Array:
    """Return coefficients k = 1.. of a record as a series (count,)."""
    whole = np.zeros(count)
    whole[1 : 1 + len(values)] = values
    return np.asarray(idct(whole, type=2, norm="ortho"))


def variances(covariance: Array) -> Array:
    """Return the exact variances (n - 1,) of the coefficients from the covariances c_0..c_n-1.

    Generalised covariances of noise with stationary increments do as well: a constant more or less
    in all of them changes nothing.
    """
    count = len(covariance)
    lag = np.arange(count)
    angle = np.pi * np.arange(1, count) / count
    shared = np.where(lag > 0, covariance, 0.0)
    even = rfft(shared * (1.0 - lag / count), 2 * count).real[1:count]
    odd = -rfft(shared / count, 2 * count).imag[1:count]
    return np.asarray(covariance[0] + 2.0 * (even - odd / np.sin(angle)))


def covariances(count: int, interval_s: float) -> Array:
    """Return the generalised covariances (4, n) of interval means for unit Q, N, B and K.

    Q in arcsec, N in deg/h sqrt(s), B in deg/h (density B^2/(2 pi f)), K in deg/h/sqrt(s). They are
    second differences of F: -(t^2/2)(ln t - 3/2)/pi for B, -t^3/12 for K.
    """
    lag = np.arange(count, dtype=np.float64)
    result = np.zeros((4, count))
    result[0, :2] = np.array([2.0, -1.0])[:count] / interval_s**2
    result[1, 0] = 1.0 / interval_s
    result[2] = -_flicker(lag) / np.pi
    result[3] = -0.5 * interval_s * lag
    result[3, 0] = -interval_s / 6.0
    return result


def noise_variances(count: int, interval_s: float) -> Array:
    """Return the variances (4, n - 1) of the coefficients for unit Q, N, B and K."""
    return np.array([variances(covariance) for covariance in covariances(count, interval_s)])


def allan_terms(tau_s: Array | float) -> Array:
    """Return the Allan variance (4, ...) of unit Q, N, B and K at averaging times."""
    tau = np.asarray(tau_s, dtype=np.float64)
    flat = np.full(tau.shape, FLICKER)
    return np.array([3.0 / tau**2, 1.0 / tau, flat, tau / 3.0])


def _flicker(lag: Array) -> Array:
    """Return the second differences of (m^2/2)(ln m - 3/2); a series where they would cancel."""

    def area(m: Array) -> Array:
        return np.where(m > 0, 0.5 * m**2 * (np.log(np.maximum(m, 1.0)) - 1.5), 0.0)

    near = area(lag + 1.0) - 2.0 * area(lag) + area(np.abs(lag - 1.0))
    far = np.maximum(lag, SERIES_FROM)
    series = np.log(far) - 1.0 / (12.0 * far**2) - 1.0 / (60.0 * far**4)
    return np.where(lag < SERIES_FROM, near, series)
