"""The figures of a table from a sensor on it: a pure function of a dataset.

The sensor's axes stand along the table's as `work` says. With n the outer axis, d the middle and e
the inner one, each turn by 180 deg mirrors a device about its axis; the sums and differences of the
eight levels separate the accelerometers' biases from the axes, and a level with the sensor turned
on its plate separates the sensor's own tilt from the encoders' zeros. All angles are small; the
square of one degree is left out, 0.01 deg.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, undetermined

from .causes import Figure, Turned, causes_of
from .parameters import AXES, HALF_TURNS

Array = NDArray[np.float64]
DEG_PER_G = math.degrees(1.0)
PLACING, SCALE, ENCODER = "placing_deg", "gyro_scale", "encoder_deg"
VERTICAL, MISALIGNMENT = "navigator_level_deg", "gyro_misalignment_deg"
BY_PLACING = {PLACING: math.sqrt(0.5), VERTICAL: math.sqrt(0.5)}
"""Half of each counts: for the two levels of a reversal the sensor is placed, and aligned, anew."""
BY_VERTICAL = {VERTICAL: 1.0}
"""What a navigator takes for the vertical stays while the table turns: no reversal shows it."""
ALONG = {
    "outer": np.array([0.0, 0.0, -1.0]),
    "middle": np.array([0.0, -1.0, 0.0]),
    "inner": np.array([1.0, 0.0, 0.0]),
}
"""Each axis along the sensor's X, Y, Z, with all axes at zero."""
SIGNS = np.array([[1.0 if angle == 0.0 else -1.0 for angle in angles] for angles in HALF_TURNS])


@dataclass(frozen=True)
class Turn:
    """A turn there and back: two angles by the encoder and the gyros, three levels at rest.

    `encoder_deg` (2,), `gyro_deg` (2, 3) and its standard uncertainty `gyro_u_deg`, `force_g`
    (3, 3); `rate_ratio` (n,) are readings of the rate over their set-points.
    """

    encoder_deg: Array
    gyro_deg: Array
    gyro_u_deg: float
    force_g: Array
    rate_ratio: Array

    @property
    def felt(self) -> Array:
        """Both turns together, by gyro, over the encoder's angle, shape (3,)."""
        sense = np.sign(self.encoder_deg)
        return np.asarray((sense @ self.gyro_deg) / np.abs(self.encoder_deg).sum())


@dataclass(frozen=True)
class Level:
    """Mean specific force in g along X, Y, Z, shape (3,), and its standard uncertainty."""

    force_g: Array
    u_g: Array


@dataclass(frozen=True)
class MotionDataset:
    """All of M1 to M3. `small` and `whole` have a turn by axis, `upright` is the outer one's.

    `levels` stand in the order of `HALF_TURNS`; `placing_u_deg` is how well the sensor stands
    against its stops, `scale_u` the relative standard uncertainty of its gyros' scale factors,
    `encoder_u_deg` that of an angle by the table's calibration record, `vertical_u_deg` that of
    what a navigator takes for the vertical, 0 for a sensor, whose accelerometers feel it;
    `misalignment_u_deg` that of a gyro's input axis towards another one.
    """

    small: Mapping[str, Turn]
    upright: Turn
    whole: Mapping[str, Turn]
    levels: tuple[Level, ...]
    turned: Level
    placing_u_deg: float
    scale_u: float
    encoder_u_deg: float = 0.0
    vertical_u_deg: float = 0.0
    misalignment_u_deg: float = 0.0


@dataclass(frozen=True)
class Leans:
    """Angles in deg: plate and axes at rest, by gravity.

    `pitch`, `roll`: of the plate at the axes' zeros; `outer` (2,): of the outer axis towards the
    inner and the middle one; `middle`: of the middle axis out of the level; `inner`: of the inner
    axis out of the plate. `noise_deg` is the largest standard uncertainty of a level by its noise,
    over root two: every figure is half a difference of two levels, or better.
    """

    pitch: float
    roll: float
    outer: Array
    middle: float
    inner: float
    noise_deg: float


def analyse(data: MotionDataset) -> Analysis:
    """Return the ratio of turns, rates, encoder zeros, leaning axes, and the causes."""
    estimates = [
        *(_turn_ratio(axis, data) for axis in AXES),
        *(_rate_ratio(axis, data) for axis in AXES),
        *_levels(leans_of(data)),
        _off_square(data.small["middle"], data.small["inner"]),
    ]
    figures = {
        (estimate.name, estimate.axis or ""): Figure(
            estimate.value or 0.0, _combined(estimate, data)
        )
        for estimate in estimates
    }
    turned = {axis: _turned(data.small[axis]) for axis in AXES}
    flags = causes_of(turned, _turned(data.upright), figures)
    return Analysis(estimates, (), flags)


def leans_of(data: MotionDataset) -> Leans:
    """Return what the levels say; see the module for how."""
    x, y = (np.array([level.force_g[k] for level in data.levels]) * DEG_PER_G for k in (0, 1))
    outer, middle, inner = SIGNS.T
    towards_x = float(np.mean(x * middle * outer))
    towards_y = -float(np.mean(y * inner * outer))
    here, turned = data.levels[0].force_g * DEG_PER_G, data.turned.force_g * DEG_PER_G
    pitch, roll = (float(here[k] - turned[k]) / 2.0 for k in (0, 1))
    return Leans(
        pitch,
        roll,
        np.array([towards_x, towards_y]),
        float(np.mean(y * inner)) - towards_y,
        pitch - towards_x - float(np.mean(x * middle)),
        float(np.max([level.u_g for level in (*data.levels, data.turned)]))
        * DEG_PER_G
        / math.sqrt(2.0),
    )


def _levels(leans: Leans) -> list[Estimate]:
    """Return zeros and leans; what a leaning outer axis explains counts to that alone.

    A zero, or the middle axis, is off by what it is against gravity or against the outer axis,
    whichever is less: a table that stands askew has all its axes askew by the same.
    """
    towards_x, towards_y = leans.outer.tolist()
    noise_deg = leans.noise_deg
    return [
        _zero("middle", _less(leans.pitch, leans.pitch - towards_x), noise_deg),
        _zero("inner", _less(leans.roll, leans.roll + towards_y), noise_deg),
        _lean("outer", math.hypot(towards_x, towards_y), noise_deg, BY_VERTICAL),
        _lean("middle", abs(_less(leans.middle, leans.middle + towards_y)), noise_deg, BY_VERTICAL),
        _lean("inner", abs(leans.inner), noise_deg, {**BY_PLACING, **BY_VERTICAL}),
    ]


def _zero(axis: str, value_deg: float, noise_deg: float) -> Estimate:
    by = {**BY_PLACING, ENCODER: 1.0}
    method = "the plate's level at zero, the sensor reversed on it"
    return Estimate("encoder_zero", axis, value_deg, "deg", noise_deg, None, method, by)


def _lean(axis: str, value_deg: float, noise_deg: float, by: Mapping[str, float]) -> Estimate:
    method = "levels by reversal of each axis"
    return Estimate("axis_lean", axis, value_deg, "deg", noise_deg, None, method, by)


def _off_square(middle: Turn, inner: Turn) -> Estimate:
    """Return by how much middle and inner axis are not square, as the gyros feel their turns.

    Gravity does not feel it: a lean within the plate's plane is a heading.
    """
    along = [turn.felt / max(float(np.linalg.norm(turn.felt)), 1e-9) for turn in (middle, inner)]
    value_deg = math.degrees(math.asin(float(along[0] @ along[1])))
    turned_deg = min(float(np.abs(turn.encoder_deg).sum()) for turn in (middle, inner))
    noise_deg = math.degrees(2.0 * max(middle.gyro_u_deg, inner.gyro_u_deg) / turned_deg)
    method = "directions of small turns along the sensor's gyros"
    by = {MISALIGNMENT: math.sqrt(2.0)}
    return Estimate("axes_off_square", None, value_deg, "deg", noise_deg, None, method, by)


def _less(first: float, second: float) -> float:
    return min(first, second, key=abs)


def _turn_ratio(axis: str, data: MotionDataset) -> Estimate:
    turn = data.whole.get(axis, data.small[axis])
    value = float(turn.felt @ ALONG[axis])
    u = turn.gyro_u_deg * math.sqrt(2.0) / float(np.abs(turn.encoder_deg).sum())
    by_angle = math.sqrt(0.5) / float(np.abs(turn.encoder_deg).max())
    method = "integral of the gyro over the encoder's angle, there and back"
    return Estimate(
        "turn_ratio", axis, value, "1", u, None, method, {SCALE: value, ENCODER: by_angle}
    )


def _rate_ratio(axis: str, data: MotionDataset) -> Estimate:
    ratios = data.whole.get(axis, data.small[axis]).rate_ratio
    method = "mean of the rate's readings over their set-points"
    if ratios.size < 2:
        return undetermined("rate_ratio", axis, "1", method)
    u = float(np.std(ratios, ddof=1)) / math.sqrt(ratios.size)
    return Estimate("rate_ratio", axis, float(ratios.mean()), "1", u, ratios.size - 1.0, method)


def _combined(estimate: Estimate, data: MotionDataset) -> float:
    known = {PLACING: data.placing_u_deg, SCALE: data.scale_u, ENCODER: data.encoder_u_deg}
    known |= {VERTICAL: data.vertical_u_deg, MISALIGNMENT: data.misalignment_u_deg}
    parts = [estimate.sensitivities[name] * known[name] for name in estimate.sensitivities]
    return math.hypot(estimate.standard_uncertainty or 0.0, *parts)


def _turned(turn: Turn) -> Turned:
    """Return a small turn as gyros and accelerometers feel it, over the encoder's angle."""
    down = -turn.force_g / np.linalg.norm(turn.force_g, axis=1, keepdims=True)
    # What is fixed to the earth turns against the sensor: the cross product of later and earlier
    # is along the turn. About the vertical there is none.
    across = np.cross(down[1], down[0])
    size = float(np.linalg.norm(across))
    turned_rad = math.radians(float(turn.encoder_deg[0]))
    by_gravity = across * (math.asin(min(size, 1.0)) / max(size, 1e-9)) / turned_rad
    return Turned(turn.felt, by_gravity, down[0])
