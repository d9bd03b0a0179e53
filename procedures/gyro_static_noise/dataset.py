"""What the analysis of gyros at rest needs, whoever recorded it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.direction import Direction
from station.findings import FlagThresholds

from .parameters import UNITS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

SECONDS_PER_HOUR = 3600.0
PER_SQRT_H = 60.0
"""deg/h sqrt(s) over deg/sqrt(h), and deg/h/sqrt(h) over deg/h/sqrt(s)."""

COEFFICIENTS = tuple(UNITS)[:4]


@dataclass(frozen=True)
class Record:
    """One switch-on, warm-up left out: `time_s` (n,) the middle of each interval, gaps possible.

    Times count from power-on; `on_s` is when that was on the run's clock, None where nobody knows.
    `rate_deg_per_h` (n, axes) is the mean over the interval, earth's rate in it.
    """

    switch_on: int
    time_s: Array
    rate_deg_per_h: Array
    on_s: float | None = None


@dataclass(frozen=True)
class StaticDataset:
    """A gyro or a triad at rest.

    `pulse_arcsec` is 0 where the output is no counts; samples of an output with a bandwidth are
    not independent up to the highest frequency. `latitude_rad` is north positive.
    """

    directions: Mapping[str, Direction]
    latitude_rad: float
    sample_interval_s: float
    pulse_arcsec: float
    output_bandwidth_Hz: float | None
    records: tuple[Record, ...]

    @property
    def quantum_deg_per_h(self) -> float:
        """One pulse as a rate."""
        return self.pulse_arcsec / self.sample_interval_s


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags, in standard uncertainties unless the name says otherwise.

    `periodic_chance`: a line must lower -2 ln L by 2 ln(n/periodic_chance).
    """

    drift_removed: float = 3.0
    periodic_chance: float = 1e-4
