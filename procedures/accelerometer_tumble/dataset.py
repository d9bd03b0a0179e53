"""What the analysis of a tumble test needs, whoever recorded it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.findings import FlagThresholds

from .model import Array, Names, model_columns

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TumbleDataset:
    """Readings (n,) of an accelerometer in positions on a rotary stage, in the order of time.

    `reverse` is -1 where the unit is turned about its input axis, else 1; `head_rad` how far the
    fixture is turned on the head, `encoder_rad` the stage's encoder: their sum is theta.
    `temperature_degC` is None where there is no thermometer. `encoder_accuracy_rad` and
    `mounting_rad` are standard uncertainties: of each of the encoder's first and second harmonics,
    and of the angle at which the unit or the fixture is set down.
    """

    time_s: Array
    plane: Names
    reverse: Array
    head_rad: Array
    commanded_rad: Array
    encoder_rad: Array
    output_V: Array
    temperature_degC: Array | None
    gravity_g: float
    encoder_accuracy_rad: float
    mounting_rad: float

    @property
    def columns(self) -> Array:
        """The model's columns at the angles that the encoder shows (n, 12)."""
        theta = self.encoder_rad + self.head_rad
        return model_columns(self.plane, self.reverse, theta, self.gravity_g)

    @property
    def mounting(self) -> NDArray[np.int64]:
        """The number of the mounting that each reading belongs to (n,), counted from 0."""
        new = (
            (self.plane[1:] != self.plane[:-1])
            | (np.diff(self.reverse) != 0.0)
            | (np.diff(self.head_rad) != 0.0)
        )
        return np.cumsum(np.append(False, new))

    def only(self, rows: Mask) -> TumbleDataset:
        """Return some of the readings."""
        names = ("time_s", "plane", "reverse", "head_rad", "commanded_rad", "encoder_rad")
        taken = {name: getattr(self, name)[rows] for name in (*names, "output_V")}
        warm = None if self.temperature_degC is None else self.temperature_degC[rows]
        return replace(self, **taken, temperature_degC=warm)


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags; `nuisance` in standard deviations of what was stated."""

    nuisance: float = 4.5
    max_drift_order: int = 3
