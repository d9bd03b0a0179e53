"""What a device on the table senses, whichever it is: rates and specific force along X, Y, Z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from station.roles.base import ARRIVAL

from .parameters import MotionParameters
from .placing import IMU

if TYPE_CHECKING:
    from station.record.folder import RunFolder

Array = NDArray[np.float64]
COUNTER_TURN = 65536
ALIGNED = 1
BODY = np.array([1.0, -1.0, -1.0])
"""A navigator's x, y, z along X, Y, Z."""


@dataclass(frozen=True)
class Sensed:
    """Outputs: run time of arrival (n,), intervals since the one before (n,), (n, 3) each.

    The first output counts as one interval; an output that was lost on the line counts to the next.
    """

    arrived_s: Array
    steps: Array
    rate_deg_per_s: Array
    force_g: Array


def sensed(folder: RunFolder, unit: str, parameters: MotionParameters) -> Sensed:
    """Return what the device sensed in a unit; ValueError where a navigator was not aligned."""
    rows = folder.rows(parameters.device, unit)
    counted = np.diff(rows["counter"].astype(np.int64))
    steps = np.concatenate(([1.0], np.mod(counted, COUNTER_TURN)))
    if parameters.device == IMU:
        rate, force = (
            np.column_stack([rows[f"{kind}_{axis}_{unit_of}"] for axis in "xyz"])
            for kind, unit_of in (("gyro", "deg_per_s"), ("accelerometer", "g"))
        )
        return Sensed(rows[ARRIVAL], steps, rate, force)
    if not (rows["status"].astype(np.int64) & ALIGNED).all():
        raise ValueError(f"{unit}: the navigator was not aligned")
    attitude = attitude_of(rows)
    turned = Rotation.from_matrix(attitude[:-1].transpose(0, 2, 1) @ attitude[1:]).as_rotvec()
    rate = np.degrees(turned) * parameters.sample_rate_Hz / steps[1:, None]
    # At rest a device feels 1 g up, and the last row of its attitude is where down lies along it.
    return Sensed(
        rows[ARRIVAL],
        steps,
        np.concatenate((np.zeros((1, 3)), rate)) * BODY,
        -attitude[:, 2] * BODY,
    )


def attitude_of(rows: NDArray[Any]) -> Array:
    """Return a navigator's axes along north, east, down as columns, shape (n, 3, 3)."""
    angles = np.column_stack([rows[f"{angle}_deg"] for angle in ("heading", "pitch", "roll")])
    return np.asarray(Rotation.from_euler("ZYX", angles, degrees=True).as_matrix())
