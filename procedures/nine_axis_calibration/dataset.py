"""What the calibration of a nine-axis sensor needs, whoever recorded it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AXES = ("X", "Y", "Z")


@dataclass(frozen=True)
class Prior:
    """What is known of the set-up beforehand, as standard uncertainties.

    `heading_rad` is common to all positions, `relative_heading_rad` and `tilt_rad` (of each of the
    two horizontal axes) are each position's own. `misalignment_rad` is that of a gyro's input axis
    towards another one where the rates did not measure it. `mounting_rad` is how far a sensor axis
    that should lie along the table's leans from it, about each of two axes, as it was mounted;
    `table_axes_rad` is what the table's axes add to that.
    """

    heading_rad: float
    relative_heading_rad: float
    tilt_rad: float
    accelerometer_bias_g: float
    misalignment_rad: float = 0.0
    mounting_rad: float = 0.0
    table_axes_rad: float = 0.0


@dataclass(frozen=True)
class StaticRecord:
    """One position at rest: `time_s` (n,) rises, the other two have shape (n, 3), axes X Y Z.

    `position` is one of `positions.ATTITUDES`. `time_s` is the end of each sample's interval.
    """

    position: int
    time_s: Array
    rate_deg_per_h: Array
    acceleration_g: Array


@dataclass(frozen=True)
class TurnRecord:
    """One axis at one rate in one sense, spin-up and settling dropped.

    The turned axis (0, 1, 2 for X, Y, Z) points up; rates and angles are positive counter-clockwise
    seen from above. `rate_deg_per_s` (n, 3) holds NaN for gyros that were not recorded.
    `encoder_deg` (n,) is the table's encoder at `time_s`, the end of each sample's interval,
    continuous or modulo 360; NaN where it was not read. `encoder_u_deg` is the standard uncertainty
    of the angle at each end that its scatter does not show: NaN where the scatter shows it.
    """

    axis: int
    commanded_deg_per_s: float
    time_s: Array
    rate_deg_per_s: Array
    encoder_deg: Array
    encoder_u_deg: float = np.nan


@dataclass(frozen=True)
class NineAxisDataset:
    """All that was recorded; `largest_rate_deg_per_s` is where the gyro saturates, if known."""

    latitude_deg: float
    prior: Prior
    static: tuple[StaticRecord, ...]
    turns: tuple[TurnRecord, ...]
    largest_rate_deg_per_s: float | None = None
