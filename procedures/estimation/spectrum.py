"""The amplitude spectrum of laser-gyro patent steps S5 and S6."""

from __future__ import annotations

from collections.abc import Sequence

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
