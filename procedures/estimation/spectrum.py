"""The amplitude spectrum of laser-gyro patent steps S5 and S6."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
