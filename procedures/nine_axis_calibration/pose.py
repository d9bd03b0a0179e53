"""The positions of the sensor on the plate, and whether it stood as its position says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from procedures.common.constants import EARTH_RATE_DEG_PER_H

from .dataset import Array
from .directions import PoseLimits

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
HORIZONTAL_PART = 0.25
SIGMAS = 6.0


def earth_rate(latitude_deg: float) -> Array:
    """Return the rotation of the earth in deg/h, shape (3,), east, north, up."""
    latitude = np.radians(latitude_deg)
    return np.array([0.0, np.cos(latitude), np.sin(latitude)]) * EARTH_RATE_DEG_PER_H


def gravity_pattern(position: int) -> Array:
    """Return what the accelerometers read in an ideal position, in g, shape (3,)."""
    return np.asarray(ATTITUDES[position] @ UP)


@dataclass(frozen=True)
class Pose:
    """The check of one position: `off_g` and `off_deg_per_h` are the largest deviations.

    `stands_as` is the position whose gravity and rotation fit best, None where none fits.
    """

    position: int
    right: bool
    off_g: float
    off_deg_per_h: float
    stands_as: int | None
    why: str = ""

    @property
    def seems(self) -> str:
        """Why it is wrong, and as which position the sensor stood where that is known."""
        return f"{self.why}, as in position {self.stands_as}" if self.stands_as else self.why


def expected_rates(position: int, latitude_deg: float) -> Array:
    """Return what ideal gyros read in a position, in deg/h, shape (3,)."""
    return np.asarray(ATTITUDES[position] @ earth_rate(latitude_deg))


def check_pose(
    position: int,
    gyro_deg_per_h: Array,
    acceleration_g: Array,
    latitude_deg: float,
    limits: PoseLimits,
) -> Pose:
    """Judge one position from its own means, shape (3,) each, before it is accepted.

    The biases are unknown then: the gyros show a wrong heading as far as it exceeds
    `limits.bias_deg_per_h`.
    """
    off_g = float(np.max(np.abs(acceleration_g - gravity_pattern(position))))
    off_deg_per_h = float(np.max(np.abs(gyro_deg_per_h - expected_rates(position, latitude_deg))))
    why = ""
    if off_g > limits.acceleration_g:
        why = f"the accelerometers are {off_g:.3g} g off"
    elif off_deg_per_h > limits.bias_deg_per_h:
        why = f"the gyros are {off_deg_per_h:.3g} deg/h off"
    allowed = limits.acceleration_g, limits.bias_deg_per_h
    like = _like(acceleration_g, gyro_deg_per_h, latitude_deg, *allowed) if why else position
    return Pose(position, not why, off_g, off_deg_per_h, like, why)


def check_together(
    positions: Sequence[int],
    gyro_deg_per_h: Array,
    gyro_u: Array,
    acceleration_g: Array,
    latitude_deg: float,
    limits: PoseLimits,
) -> tuple[Pose, ...]:
    """Judge all positions, means of shape (p, 3), with the biases free.

    A position with gravity along another axis is wrong. Of the others the fewest are called wrong
    without which the gyros agree: within a quarter of the horizontal earth rate and
    `limits.rate_deg_per_h`, noise aside. Where none agree but all would with one of them if they
    stood as other positions, that one is right.
    """
    patterns = np.array([gravity_pattern(position) for position in positions]).reshape(-1, 3)
    expected = [expected_rates(position, latitude_deg) for position in positions]
    off = gyro_deg_per_h - np.array(expected).reshape(-1, 3)
    off_g = np.max(np.abs(acceleration_g - patterns), axis=1)
    there = (off_g <= limits.acceleration_g) & np.isfinite(off).all(axis=1)
    upright: list[int] = np.flatnonzero(there).tolist()
    horizontal = float(np.linalg.norm(earth_rate(latitude_deg)[:2]))
    allowed = min(limits.rate_deg_per_h, HORIZONTAL_PART * horizontal)

    def like(n: int, bias: Array, allowed: float) -> int | None:
        rates = gyro_deg_per_h[n] - bias
        return _like(acceleration_g[n], rates, latitude_deg, limits.acceleration_g, 2.0 * allowed)

    kept = _agreeing(off, gyro_u, upright, allowed)
    if not kept and len(upright) > 1:
        # None where several may be right: which is right is then unknown.
        right = [n for n in upright if all(like(m, off[n], 1.0) for m in upright if m != n)]
        kept = tuple(right) if len(right) == 1 else ()
    middle = np.mean(off[list(kept)], axis=0) if kept else np.zeros(3)
    poses = []
    for n, position in enumerate(positions):
        left = float(np.max(np.abs(off[n] - middle)))
        if n in kept:
            poses.append(Pose(position, True, float(off_g[n]), left, position))
            continue
        why = f"the accelerometers are {off_g[n]:.3g} g off"
        if n in upright:
            why = f"its gyro means are {left:.3g} deg/h off those of the others"
        elif not np.isfinite(off_g[n]):
            why = "an accelerometer or a gyro gives nothing there"
        poses.append(Pose(position, False, float(off_g[n]), left, like(n, middle, allowed), why))
    return tuple(poses)


def _agreeing(off: Array, u: Array, rows: Sequence[int], allowed: float) -> tuple[int, ...]:
    """Return the largest group of positions whose deviations differ by their noise only."""
    for size in range(len(rows), 1, -1):
        fitting = []
        for group in combinations(rows, size):
            inside = off[list(group)]
            left = np.abs(inside - inside.mean(axis=0))
            if bool(np.all(left <= np.maximum(allowed, SIGMAS * u[list(group)]))):
                fitting.append((float(np.sum(left**2)), group))
        if fitting:
            return min(fitting)[1]
    # Of two that contradict each other neither can be called wrong; one alone contradicts none.
    return tuple(rows) if len(rows) == 1 else ()


def _like(
    acceleration_g: Array, rates: Array, latitude_deg: float, off_g: float, off_deg_per_h: float
) -> int | None:
    """Return the first position that means (3,) of accelerometers and gyros are those of."""
    for position in ATTITUDES:
        forces = np.abs(acceleration_g - gravity_pattern(position)) <= off_g
        turning = np.abs(rates - expected_rates(position, latitude_deg)) <= off_deg_per_h
        if bool(forces.all() and turning.all()):
            return position
    return None
