"""The gyros' sensitivity to specific force, from what they read of turns beside the rate."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from procedures.nine_axis_calibration.dataset import AXES
from procedures.nine_axis_calibration.pose import earth_rate
from station.findings import Estimate, undetermined

from .inertial import Inertial
from .stands import OtherAxes

NAME, UNIT = "g_sensitivity", "deg/h/g"
UNKNOWNS = 4
"""A gyro's bias, and its sensitivity to the force along each axis."""


def g_sensitivity(data: OtherAxes, inertial: Inertial) -> Iterator[Estimate]:
    """Yield each gyro's sensitivity; null where the mountings have fewer than four directions.

    At no rate a gyro reads its bias, the earth's rate along the table's axis, and that.
    """
    mounted = [
        (orientation.response, up)
        for orientation, up in zip(inertial.orientations, inertial.up, strict=True)
        if orientation.response is not None
        and np.isfinite(orientation.response.still_deg_per_h).all()
    ]
    nominal = np.array(
        [
            orientation.up
            for orientation in inertial.orientations
            if orientation.response is not None
        ]
    )
    design = np.column_stack((np.ones(len(nominal)), nominal)) if len(nominal) else np.zeros((0, 4))
    determined = len(mounted) == len(nominal) and np.linalg.matrix_rank(design) == UNKNOWNS
    upwards = float(earth_rate(data.latitude_deg)[2])
    for gyro, name in enumerate(AXES):
        if not determined:
            yield from (undetermined(NAME, name + axis, UNIT, "least-squares") for axis in AXES)
            continue
        left = [r.still_deg_per_h[gyro] - r.gain[gyro] * upwards for r, _ in mounted]
        u = np.array([r.still_u[gyro] for r, _ in mounted])
        rows = np.column_stack(
            (np.ones(len(mounted)), data.gravity_g * np.array([n for _, n in mounted]))
        )
        inverse = np.linalg.inv((rows / u[:, None]).T @ (rows / u[:, None]))
        solved = inverse @ ((rows / u[:, None]).T @ (np.array(left) / u))
        for n, axis in enumerate(AXES, 1):
            size = float(np.sqrt(inverse[n, n]))
            yield Estimate(NAME, name + axis, float(solved[n]), UNIT, size, None, "least-squares")
