"""What the analysis of a gyro on a rate table needs, whoever recorded it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.common.constants import EARTH_RATE_DEG_PER_H
from station.findings import FlagThresholds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PPM = 1e6


@dataclass(frozen=True)
class Record:
    """One rate in one sense, or the table standing (0 commanded), n samples.

    `time_s` (n,) is the middle of each sample's interval, counted from power-on of the `repeat`;
    gaps are possible. `start_deg` and `end_deg` (n,) are the table's angle at both ends of each
    interval, turns counted, positive counter-clockwise seen from above like the rates; NaN where it
    is not known. `unsteady` (n,) marks samples in which the table was not at its rate;
    `wild_readings` of the encoder did not fit the turn. `angle_u_deg` is the standard uncertainty
    of the angle at each end of the record that the scatter of the samples does not show.
    """

    repeat: int
    commanded_deg_per_s: float
    time_s: Array
    rate_deg_per_s: Array
    start_deg: Array
    end_deg: Array
    unsteady: Mask
    wild_readings: int = 0
    angle_u_deg: float = 0.0

    @property
    def table_deg_per_interval(self) -> Array:
        """How far the table turned in each interval (n,)."""
        return self.end_deg - self.start_deg


@dataclass(frozen=True)
class RateTableDataset:
    """A gyro on a table that turns about the vertical, its input axis up.

    `quantum_deg_per_s` is one count as a rate, 0 for rates; `encoder_accuracy_deg` the standard
    deviation of the encoder's error within a turn. `range_deg_per_s` is the gyro's full scale, None
    where it is not stated.
    """

    latitude_rad: float
    sample_interval_s: float
    quantum_deg_per_s: float
    encoder_accuracy_deg: float
    records: tuple[Record, ...]
    range_deg_per_s: float | None = None

    @property
    def earth_up_deg_per_h(self) -> float:
        """The vertical part of the earth's rate."""
        return float(EARTH_RATE_DEG_PER_H * np.sin(self.latitude_rad))

    @property
    def earth_level_deg_per_h(self) -> float:
        """The horizontal part of the earth's rate."""
        return float(EARTH_RATE_DEG_PER_H * np.cos(self.latitude_rad))


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags, in standard uncertainties unless the name says otherwise.

    `part_turns`: part of the turned angle beyond whole turns; `rate_differs`: of the commanded
    rate.
    """

    nonlinearity_not_significant: float = 3.0
    drift_removed: float = 3.0
    part_turns: float = 0.05
    rate_differs: float = 0.01
