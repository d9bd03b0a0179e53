"""The source document's own formula: steps S5 to S7."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.noise import grid_index
from procedures.estimation.spectrum import amplitude_spectrum, peak_near
from station.findings import Published

from .dataset import Segment
from .findings import QUANTITY, UNIT

Array = NDArray[np.float64]


def published_value(segment: Segment, axis: str) -> Published:
    """Evaluate S5 to S7 for one driven axis: DFT of the samples as recorded, peak near f, y / M.

    f and M are the commanded ones. The peak is the largest of the line nearest to f and its two
    neighbours. The rule needs N samples in an unbroken row: where rows are missing it cannot run as
    written, nothing is filled in and the value is None. Of a record that is averaged the lines that
    the rule reads were summed up from its samples before.
    """
    drive = segment.drive[axis]
    amplitude = (
        _amplitude(segment, drive.frequency_Hz)
        if segment.averaged is None
        else segment.averaged.amplitude_deg_per_h[axis]
    )
    value = None
    if amplitude is not None and drive.amplitude_mT > 0.0:
        value = amplitude / drive.amplitude_mT
    return Published(QUANTITY, axis, value, UNIT, "dft-peak")


def _amplitude(segment: Segment, wanted_Hz: float) -> float | None:
    rate = segment.rate_deg_per_h
    whole = len(rate) >= 3 and not missing_rows(segment) and bool(np.all(np.isfinite(rate)))
    if not whole:
        return None
    frequency_Hz, amplitude = amplitude_spectrum(rate, segment.sample_interval_s)
    return peak_near(frequency_Hz, amplitude, wanted_Hz)


def missing_rows(segment: Segment) -> int:
    """Count the grid places between the first and the last sample that hold no sample."""
    index = grid_index(segment.time_s, segment.sample_interval_s)
    return int(index[-1]) + 1 - len(index)


def plotted_spectrum(segment: Segment) -> tuple[Array, Array]:
    """Return the spectrum of S6 to look at; where rows are missing, about the mean without them."""
    if len(segment.time_s) < 3:
        return np.zeros(0), np.zeros(0)
    rate = np.where(np.isfinite(segment.rate_deg_per_h), segment.rate_deg_per_h, np.nan)
    index = grid_index(segment.time_s, segment.sample_interval_s)
    present = np.isfinite(rate)
    places = int(index[-1]) + 1
    if bool(present.all()) and places == len(index):
        return amplitude_spectrum(rate, segment.sample_interval_s)
    if not bool(present.any()):
        return np.zeros(0), np.zeros(0)
    mean = float(np.mean(rate[present]))
    series = np.zeros(places)
    series[index[present]] = rate[present] - mean
    frequency_Hz, amplitude = amplitude_spectrum(series, segment.sample_interval_s)
    amplitude *= places / int(present.sum())
    amplitude[0] = abs(mean)
    return frequency_Hz, amplitude
