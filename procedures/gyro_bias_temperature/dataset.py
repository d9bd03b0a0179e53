"""What the analysis of a gyro's bias over temperature needs, whoever recorded it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.direction import Direction
from station.findings import FlagThresholds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class TemperatureDataset:
    """A gyro or a triad at rest in a chamber, one switch-on, a row an interval; gaps are possible.

    `time_s` (n,) rises and is the middle of each interval. `rate_deg_per_h` (n, axes) holds the
    earth's rate, `gyro_degC` (n,) is the gyro's own thermometer, None without one; `soaking` says
    that the set-point stands. `sensor_lag_prior_s` is the standard uncertainty of how far the
    thermometer runs ahead of what the bias follows.
    """

    directions: Mapping[str, Direction]
    latitude_rad: float
    sample_interval_s: float
    reference_degC: float
    sensor_lag_prior_s: float
    time_s: Array
    soaking: Mask
    set_point_degC: Array
    rate_deg_per_h: Array
    gyro_degC: Array | None
    chamber_degC: Array

    @property
    def temperature_degC(self) -> Array:
        """The temperature that the model follows: the gyro's own, else the chamber's."""
        return self.chamber_degC if self.gyro_degC is None else self.gyro_degC


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags, in standard uncertainties unless the name says otherwise."""
