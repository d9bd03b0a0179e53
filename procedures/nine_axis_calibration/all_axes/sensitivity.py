"""The gyros' sensitivity to specific force, from what they read of turns beside the rate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from procedures.nine_axis_calibration.dataset import AXES
from procedures.nine_axis_calibration.pose import earth_rate
from station.findings import Estimate, undetermined

from .inertial import Inertial
from .response import Response
from .stands import Array, OtherAxes

NAME, UNIT, METHOD = "g_sensitivity", "deg/h/g", "least-squares"
UNKNOWNS = 4
"""A gyro's bias, and its sensitivity to the force along each axis."""
SECONDS_PER_HOUR = 3600.0


def g_sensitivity(data: OtherAxes, inertial: Inertial) -> Iterator[Estimate]:
    """Yield each gyro's sensitivity; null where the mountings have fewer than four directions.

    All records of a gyro together: beside what grows with the rate, a gain for each mounting, it
    reads its bias, the earth's rate along the table's axis, the force, and what grows with the
    magnitude of its own rate. That one is a gyro's own: mountings of several rates give it for
    those of one.
    """
    mounted = [
        (orientation.response, nominal, up)
        for orientation, nominal, up in zip(
            inertial.orientations,
            [orientation.up for orientation in inertial.orientations],
            inertial.up,
            strict=True,
        )
        if orientation.response is not None
    ]
    nominal = np.array([nominal for _, nominal, _ in mounted])
    design = np.column_stack((np.ones(len(nominal)), nominal)) if len(nominal) else np.zeros((0, 4))
    determined = bool(np.linalg.matrix_rank(design) == UNKNOWNS)
    for gyro, name in enumerate(AXES):
        solved = _solved(data, [(r, up) for r, _, up in mounted], gyro) if determined else None
        for n, axis in enumerate(AXES, 1):
            if solved is None:
                yield undetermined(NAME, name + axis, UNIT, METHOD)
            else:
                value, u = float(solved[0][n]), float(solved[1][n])
                yield Estimate(NAME, name + axis, value, UNIT, u, None, METHOD)


def _solved(
    data: OtherAxes, mounted: Sequence[tuple[Response, Array]], gyro: int
) -> tuple[Array, Array] | None:
    """Return bias and sensitivities (4,) of a gyro in deg/h and deg/h/g, and their u; or None."""
    earth_deg_per_h = float(earth_rate(data.latitude_deg)[2])
    rows, read, size = [], [], []
    for place, (response, up) in enumerate(mounted):
        gains = np.zeros(len(mounted))
        for n, rate in enumerate(response.rate_deg_per_s):
            mean, u = response.mean_deg_per_s[n, gyro], response.mean_u[n, gyro]
            if not (np.isfinite(mean) and u > 0.0):
                continue
            gains[place] = SECONDS_PER_HOUR * rate + earth_deg_per_h
            own = SECONDS_PER_HOUR * abs(rate * up[gyro])
            rows.append([1.0, *(data.gravity_g * up), own, *gains])
            read.append(SECONDS_PER_HOUR * mean)
            size.append(SECONDS_PER_HOUR * u)
    if not rows:
        return None
    weighted = np.array(rows) / np.array(size)[:, None]
    scale = np.linalg.norm(weighted, axis=0)
    if not bool(np.all(scale > 0.0)):
        return None
    weighted /= scale
    if np.linalg.matrix_rank(weighted, tol=1e-6) < weighted.shape[1]:
        # At one rate only an asymmetry is the same in all mountings: it is in the bias.
        keep = np.arange(weighted.shape[1]) != UNKNOWNS
        weighted, scale = weighted[:, keep], scale[keep]
        if np.linalg.matrix_rank(weighted, tol=1e-6) < weighted.shape[1]:
            return None
    inverse = np.linalg.inv(weighted.T @ weighted)
    solved = inverse @ (weighted.T @ (np.array(read) / np.array(size))) / scale
    return solved[:UNKNOWNS], (np.sqrt(np.diag(inverse)) / scale)[:UNKNOWNS]
