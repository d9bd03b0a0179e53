"""The positions of the sensor on the plate, and what its axes feel there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EARTH_RATE_deg_per_h = 15.041067
"""Sidereal rotation (WGS 84)."""

EAST, NORTH, UP = np.eye(3)

ATTITUDES: dict[int, Array] = {
    1: np.array([EAST, NORTH, UP]),
    2: np.array([-NORTH, EAST, UP]),
    3: np.array([NORTH, UP, EAST]),
    4: np.array([-EAST, -NORTH, UP]),
    5: np.array([NORTH, -EAST, UP]),
    6: np.array([-NORTH, UP, -EAST]),
}
"""Body axes X, Y, Z (rows) in east, north, up. 1 to 3 are published; 4 to 6 are the same turned by
180 deg about the vertical, so that the axis that faced east faces west."""

PUBLISHED = (1, 2, 3)
EAST_AXIS = {1: 0, 2: 1, 3: 2}


def earth_rate(latitude_deg: float) -> Array:
    """Return the rotation of the earth in deg/h, shape (3,), east, north, up."""
    latitude = np.radians(latitude_deg)
    return np.array([0.0, np.cos(latitude), np.sin(latitude)]) * EARTH_RATE_deg_per_h


def gravity_pattern(position: int) -> Array:
    """Return what the accelerometers read in an ideal position, in g, shape (3,)."""
    return np.asarray(ATTITUDES[position] @ UP)
