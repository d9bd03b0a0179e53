"""The positions of the sensor on the plate, and whether it stood as its position says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from procedures.common.constants import EARTH_RATE_DEG_PER_H

from .dataset import Array
from .settings import PoseLimits

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


def expected_rates(position: int, latitude_deg: float) -> Array:
    """Return what ideal gyros read in a position, in deg/h, shape (3,)."""
    return np.asarray(ATTITUDES[position] @ earth_rate(latitude_deg))


def check_pose(
    position: int,
    gyro_deg_per_h: Array,
    acceleration_g: Array,
    latitude_deg: float,
    limits: PoseLimits | None = None,
) -> Pose:
    """Judge one position from its own means, shape (3,) each, before it is accepted.

    The biases are unknown then: the gyros show a wrong heading as far as it exceeds
    `limits.bias_deg_per_h`.
    """
    limits = limits or PoseLimits()
    off_g = float(np.max(np.abs(acceleration_g - gravity_pattern(position))))
    off_rate = gyro_deg_per_h - expected_rates(position, latitude_deg)
    off_deg_per_h = float(np.max(np.abs(off_rate)))
    stands_as = None
    for other in ATTITUDES:
        fits = np.abs(acceleration_g - gravity_pattern(other)) <= limits.acceleration_g
        rates = np.abs(gyro_deg_per_h - expected_rates(other, latitude_deg))
        if bool(fits.all()) and bool(np.all(rates <= limits.bias_deg_per_h)):
            stands_as = other
            break
    if off_g > limits.acceleration_g:
        why = f"the accelerometers are {off_g:.3g} g off"
        return Pose(position, False, off_g, off_deg_per_h, stands_as, why)
    if off_deg_per_h > limits.bias_deg_per_h:
        why = f"the gyros are {off_deg_per_h:.3g} deg/h off"
        return Pose(position, False, off_g, off_deg_per_h, stands_as, why)
    return Pose(position, True, off_g, off_deg_per_h, position)


def check_direction(
    up: tuple[float, float, float], acceleration_g: Array, limit_g: float
) -> tuple[bool, str]:
    """Return whether accelerometers, (3,), feel gravity along a direction, and what they feel."""
    off_g = float(np.max(np.abs(acceleration_g - np.array(up))))
    felt = ", ".join(f"{value:+.2f}" for value in acceleration_g)
    return off_g <= limit_g, f"the accelerometers read {felt} g, {off_g:.3g} g off"


def check_together(
    positions: Sequence[int],
    gyro_deg_per_h: Array,
    gyro_u: Array,
    acceleration_g: Array,
    latitude_deg: float,
    limits: PoseLimits | None = None,
) -> tuple[Pose, ...]:
    """Judge all positions, means of shape (p, 3), with the biases free.

    A position with gravity along another axis is wrong. Of the others the fewest are called wrong
    without which the gyros agree: within a quarter of the horizontal earth rate and
    `limits.rate_deg_per_h`, noise aside.
    """
    limits = limits or PoseLimits()
    expected = np.array([expected_rates(position, latitude_deg) for position in positions]).reshape(
        -1, 3
    )
    patterns = np.array([gravity_pattern(position) for position in positions]).reshape(-1, 3)
    off_g = np.max(np.abs(acceleration_g - patterns), axis=1)
    off = gyro_deg_per_h - expected
    upright = [
        n
        for n in range(len(positions))
        if off_g[n] <= limits.acceleration_g and bool(np.isfinite(off[n]).all())
    ]
    horizontal = float(np.linalg.norm(earth_rate(latitude_deg)[:2]))
    allowed = min(limits.rate_deg_per_h, HORIZONTAL_PART * horizontal)
    kept = _agreeing(off, gyro_u, upright, allowed)
    if not kept and len(upright) > 1:
        kept = _one_right(gyro_deg_per_h, expected, acceleration_g, upright, latitude_deg, limits)
    middle = np.mean(off[list(kept)], axis=0) if kept else np.zeros(3)
    poses = []
    for n, position in enumerate(positions):
        left = float(np.max(np.abs(off[n] - middle)))
        why = ""
        if n not in upright:
            why = f"the accelerometers are {off_g[n]:.3g} g off"
            if not np.isfinite(off_g[n]):
                why = "an accelerometer or a gyro gives nothing there"
        elif n not in kept:
            why = f"its gyro means are {left:.3g} deg/h off those of the others"
        stands_as = (
            position
            if n in kept
            else _best(
                acceleration_g[n],
                gyro_deg_per_h[n] - middle,
                latitude_deg,
                limits.acceleration_g,
                allowed,
            )
        )
        poses.append(Pose(position, n in kept, float(off_g[n]), left, stands_as, why))
    return tuple(poses)


def _agreeing(off: Array, u: Array, rows: Sequence[int], allowed: float) -> tuple[int, ...]:
    """Return the largest group of positions whose deviations differ by their noise only."""
    for size in range(len(rows), 1, -1):
        best: tuple[float, tuple[int, ...]] | None = None
        for group in combinations(rows, size):
            inside = off[list(group)]
            left = np.abs(inside - inside.mean(axis=0))
            if bool(np.all(left <= np.maximum(allowed, SIGMAS * u[list(group)]))):
                spread = float(np.sum(left**2))
                if best is None or spread < best[0]:
                    best = (spread, group)
        if best is not None:
            return best[1]
    # Of two that contradict each other neither can be called wrong; one alone contradicts none.
    return tuple(rows) if len(rows) == 1 else ()


def _one_right(
    gyro: Array,
    expected: Array,
    acceleration_g: Array,
    rows: Sequence[int],
    latitude_deg: float,
    limits: PoseLimits,
) -> tuple[int, ...]:
    """Return the one position that is right, where others would agree with it as other ones.

    None where that holds for several: which is right is then unknown.
    """
    possible = []
    for right in rows:
        bias = gyro[right] - expected[right]
        others = [n for n in rows if n != right]
        fits = [
            _best(acceleration_g[n], gyro[n] - bias, latitude_deg, limits.acceleration_g, 1.0)
            for n in others
        ]
        if all(fit is not None for fit in fits):
            possible.append(right)
    return (possible[0],) if len(possible) == 1 else ()


def _best(
    acceleration_g: Array, rates: Array, latitude_deg: float, allowed_g: float, allowed: float
) -> int | None:
    for other in ATTITUDES:
        fits = np.abs(acceleration_g - gravity_pattern(other)) <= allowed_g
        if bool(fits.all()) and bool(
            np.all(np.abs(rates - expected_rates(other, latitude_deg)) <= 2.0 * allowed)
        ):
            return other
    return None
