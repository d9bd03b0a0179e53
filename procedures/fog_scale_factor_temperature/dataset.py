"""What the analysis of a gyro's scale factor against temperature needs, whoever recorded it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Names = NDArray[np.str_]
Index = NDArray[np.int64]

TurnSense = Literal["heading", "about-up"]
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class TurnTable:
    """Turns of a three-axis table, one row each, in the order in which they were made.

    Every array has shape (rows,) but the attitudes. `set_number` counts the rounds over the axes;
    `axis` is the body axis that points up and that the turn is about; `commanded_deg` is signed in
    the table's sense, 0 for a wait at rest. `attitude_before_deg` and `attitude_after_deg` (rows,
    3) are heading, pitch and roll (NED, C_b^n = Rz Ry Rx), pitch and roll NaN where the navigator
    gives heading alone. Temperatures are the turned gyro's own; the chamber's is NaN where nobody
    read it.
    """

    set_number: Index
    before_s: Array
    after_s: Array
    axis: Names
    commanded_deg: Array
    attitude_before_deg: Array
    attitude_after_deg: Array
    temperature_before_degC: Array
    temperature_after_degC: Array
    chamber_degC: Array

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.before_s)

    @property
    def temperature_degC(self) -> Array:
        """The model's argument: the mean of the gyro's temperature before and after, (rows,)."""
        return 0.5 * (self.temperature_before_degC + self.temperature_after_degC)

    @property
    def duration_s(self) -> Array:
        """Time between the two readings of a turn, (rows,)."""
        return self.after_s - self.before_s

    @property
    def middle_s(self) -> Array:
        """Time in the middle of a turn, (rows,)."""
        return 0.5 * (self.before_s + self.after_s)


@dataclass(frozen=True)
class Drive:
    """A drive for the vehicle test: body rates and gyro temperatures at times that rise.

    `rate_deg_per_s` and `temperature_degC` have shape (rows, 3): x forward, y right, z down, earth
    rate included. `heading_deg` (rows,) is a reference heading; without one the vehicle ends in the
    heading in which it began. `first_heading_known` says whether `first_heading_deg`, the
    heading in which it began, is more than a guess.
    """

    time_s: Array
    rate_deg_per_s: Array
    temperature_degC: Array
    latitude_deg: float
    heading_deg: Array | None = None
    first_heading_deg: float = 0.0
    first_heading_known: bool = False


@dataclass(frozen=True)
class FogDataset:
    """All that is known of a gyro over temperature.

    `turns` are those that the model is fitted to, `verification` those of another ramp and `drive`
    a vehicle test; neither enters the fit. `gyro_bias_deg_per_h` is the specification, a standard
    uncertainty, None where nobody gave it. The noises are those that the instruments' papers state.
    `history` holds temperatures against time for the report, in degC, by name: arrays (rows, 2) of
    time in s and temperature.
    """

    turns: TurnTable
    turn_sense: TurnSense
    full_attitude: bool
    gyro_bias_deg_per_h: float | None = None
    heading_resolution_deg: float = 0.0
    angle_random_walk_deg_per_sqrt_h: float | None = None
    turntable_accuracy_arcsec: float | None = None
    reference_temperature_degC: float = 20.0
    initial_order: int = 4
    temperature_range_degC: tuple[float, float] | None = None
    verification: TurnTable | None = None
    drive: Drive | None = None
    history: Mapping[str, Array] = field(default_factory=dict)
