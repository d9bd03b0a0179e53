"""The rows that a solution is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .model import Names, accelerations, accelerations_by_angle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """The usable rows, each array (rows,): encoder angle, measured field, output in V.

    `root_weight` is one over the noise where it is known before anything is solved. `groups` names
    the rows that share an angle or a field.
    """

    time_s: Array
    plane: Names
    theta_rad: Array
    field_T: Array
    commanded_T: Array
    output_V: Array
    temperature_degC: Array | None
    noise_group: NDArray[np.int64] | None
    gravity_g: float = 1.0
    root_weight: Array | None = None
    groups: Mapping[str, Names] = field(default_factory=dict)

    @property
    def slope(self) -> Array:
        """Return the derivative of Ai by the angle, g/rad (rows,)."""
        return accelerations_by_angle(self.plane, self.theta_rad, self.gravity_g)[:, 0]

    def accelerations(self, offset_rad: Array | float = 0.0) -> Array:
        """Return Ai, Ao, Ap in g (rows, 3) at an encoder offset."""
        return accelerations(self.plane, self.theta_rad + offset_rad, self.gravity_g)
