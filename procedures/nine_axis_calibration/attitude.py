"""Gyro biases from all nine means at once, the attitude of each position known by its prior only.

The unknowns are three biases, one heading common to all positions, a further heading and two tilts
of each position, three accelerometer biases and six misalignments. The data are the gyro means and
the means of the horizontal accelerometers; everything but the biases has a prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .dataset import Array, Mask, Prior
from .pose import ATTITUDES, earth_rate

ROUNDS = 3
SMALLEST_PRIOR = 1e-9
HEADING_CONTRADICTED = 2.0
BIASES, HEADING, ACCELEROMETER, MISALIGNED, OWN = 3, 1, 3, 6, 3
FIRST_OWN = BIASES + HEADING + ACCELEROMETER + MISALIGNED
PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
"""Gyro and axis of each misalignment: XY XZ YX YZ ZX ZY."""


@dataclass(frozen=True)
class GyroGain:
    """How the gyros answer: K of each (3,), and cross gains over K (6,) in the order of PAIRS."""

    scale_factor: Array
    misalignment: Array
    misalignment_u: Array


@dataclass(frozen=True)
class StaticMeans:
    """Means of the used positions: gyros in deg/h and accelerometers in g, each (p, 3)."""

    positions: tuple[int, ...]
    gyro: Array
    gyro_u: Array
    accelerometer: Array
    accelerometer_u: Array


@dataclass(frozen=True)
class BiasSolution:
    """Biases (3,) in deg/h with their covariance, and where their uncertainty comes from.

    `noise_u` (3,) is the part of the data's noise; `parts` gives that of each prior,
    `by_latitude` (3,) what the biases gain, deg/h per rad. `residual`
    (p, 3) is gyro mean less model. `heading_used` says whether the prior of the heading took part:
    it does not where the gyros contradict it. `tilt_rad` (p, 2) is the rotation of each position
    about east and north.
    """

    bias: Array
    covariance: Array
    noise_u: Array
    parts: Mapping[str, Array]
    heading_rad: float
    heading_u: float
    heading_used: bool
    own_heading_rad: Array
    tilt_rad: Array
    by_latitude: Array
    residual: Array
    chi_square: float
    degrees_of_freedom: int


def solve_biases(
    means: StaticMeans, latitude_deg: float, prior: Prior, gain: GyroGain
) -> BiasSolution:
    """Solve all means for the biases; the heading's prior is left out where the gyros deny it.

    A heading that lies more than two standard deviations from its prior is taken from the gyros
    alone: the prior then helps by a hundredth at most, and would mislead.
    """
    if len(set(means.positions)) < 2:
        return _solve(means, latitude_deg, prior, gain, use_heading=True)
    free = _solve(means, latitude_deg, prior, gain, use_heading=False)
    spread = np.hypot(free.heading_u, prior.heading_rad)
    if abs(free.heading_rad) > HEADING_CONTRADICTED * spread:
        return free
    return _solve(means, latitude_deg, prior, gain, use_heading=True)


def _solve(
    means: StaticMeans, latitude_deg: float, prior: Prior, gain: GyroGain, *, use_heading: bool
) -> BiasSolution:
    count = len(means.positions)
    nominal = np.array([ATTITUDES[position] for position in means.positions])
    level = np.abs(nominal[:, :, 2]) < 0.5
    names, sizes, centres = _priors(prior, gain, count, use_heading=use_heading)
    data = np.concatenate((means.gyro.ravel(), means.accelerometer[level], centres))
    size = np.concatenate((means.gyro_u.ravel(), means.accelerometer_u[level], sizes))
    state = np.zeros(FIRST_OWN + OWN * count)
    state[FIRST_OWN - MISALIGNED : FIRST_OWN] = gain.misalignment
    turning, by_latitude = earth_rate(latitude_deg), earth_rate(latitude_deg + 90.0)
    for _ in range(ROUNDS):
        model, jacobian = _model(state, nominal, level, turning, gain.scale_factor)
        prior_rows = _prior_rows(len(state), count, use_heading=use_heading)
        design = np.vstack((jacobian, prior_rows))
        left = data - np.concatenate((model, prior_rows @ state))
        q, r = np.linalg.qr(design / size[:, None])
        inverse = np.linalg.inv(r)
        state = state + inverse @ (q.T @ (left / size))
    model, _ = _model(state, nominal, level, turning, gain.scale_factor)
    left = data - np.concatenate((model, prior_rows @ state))
    # The model is linear in the earth's rate.
    more, _ = _model(state, nominal, level, turning + by_latitude, gain.scale_factor)
    change = np.concatenate((model - more, np.zeros(len(centres))))
    covariance = inverse @ inverse.T
    share = ((inverse @ q.T)[:BIASES]) ** 2
    noise = share[:, : len(data) - len(centres)].sum(axis=1)
    parts: dict[str, Array] = {}
    for n, name in enumerate(names):
        own = share[:, len(data) - len(centres) + n]
        parts[name] = parts.get(name, np.zeros(BIASES)) + own
    own_state = state[FIRST_OWN:].reshape(count, OWN)
    return BiasSolution(
        bias=state[:BIASES],
        covariance=covariance[:BIASES, :BIASES],
        noise_u=np.sqrt(noise),
        parts={name: np.sqrt(value) for name, value in parts.items()},
        by_latitude=(inverse @ (q.T @ (change / size)))[:BIASES],
        heading_rad=float(state[BIASES]),
        heading_u=float(np.sqrt(covariance[BIASES, BIASES])),
        heading_used=use_heading,
        own_heading_rad=own_state[:, 0],
        tilt_rad=own_state[:, 1:],
        residual=left[: 3 * count].reshape(count, 3),
        chi_square=float(np.sum((left / size) ** 2)),
        degrees_of_freedom=len(data) - len(state),
    )


def _priors(
    prior: Prior, gain: GyroGain, count: int, *, use_heading: bool
) -> tuple[list[str], Array, Array]:
    """Return name, standard uncertainty and centre of each prior, in the order of its row."""
    names = ["heading"] * use_heading + ["accelerometer_bias"] * ACCELEROMETER
    names += ["misalignment"] * MISALIGNED + ["relative_heading", "tilt", "tilt"] * count
    size = {
        "heading": prior.heading_rad,
        "accelerometer_bias": prior.accelerometer_bias_g,
        "relative_heading": prior.relative_heading_rad,
        "tilt": prior.tilt_rad,
    }
    sizes = np.array([size.get(name, 0.0) for name in names])
    centres = np.zeros(len(names))
    first = use_heading + ACCELEROMETER
    sizes[first : first + MISALIGNED] = gain.misalignment_u
    centres[first : first + MISALIGNED] = gain.misalignment
    return names, np.maximum(sizes, SMALLEST_PRIOR), centres


def _prior_rows(width: int, count: int, *, use_heading: bool) -> Array:
    """Return the rows that pick the unknowns with a prior out of the state."""
    rows = np.eye(width)[BIASES:]
    return rows if use_heading else rows[1:]


def rotation(turn_rad: Array) -> Array:
    """Return the matrix of a rotation by the vector `turn_rad` (3,) (Rodrigues)."""
    angle = float(np.linalg.norm(turn_rad))
    x, y, z = turn_rad
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def _model(
    state: Array, nominal: Array, level: Mask, turning: Array, scale_factor: Array
) -> tuple[Array, Array]:
    """Return what the gyros and the horizontal accelerometers read, and the derivatives.

    Derivatives by rotations are those of a further small rotation, exact to first order in the
    rotation itself; the residuals are exact.
    """
    count = len(nominal)
    bias, heading = state[:BIASES], state[BIASES]
    accelerometer = state[BIASES + 1 : BIASES + 1 + ACCELEROMETER]
    gain = np.eye(3)
    for n, (gyro, axis) in enumerate(PAIRS):
        gain[gyro, axis] = state[FIRST_OWN - MISALIGNED + n]
    gain *= scale_factor[:, None]
    gyros, horizontal = np.empty((count, 3)), np.empty((count, 3))
    by_gyro = np.zeros((count, 3, len(state)))
    by_horizontal = np.zeros((count, 3, len(state)))
    for p in range(count):
        own = FIRST_OWN + OWN * p
        extra, east, north = state[own : own + OWN]
        # A heading grows clockwise seen from above, a rotation about up the other way.
        axes = nominal[p] @ rotation(np.array([east, north, -(heading + extra)])).T
        felt = axes @ turning
        gyros[p] = bias + gain @ felt
        horizontal[p] = accelerometer + axes[:, 2]
        # d(axis) = e x axis for a rotation about each of east, north, up.
        moved = np.cross(np.eye(3)[:, None, :], axes[None, :, :])
        turned, leaning = gain @ (moved @ turning).T, moved[:, :, 2].T
        by_gyro[p, :, :BIASES] = np.eye(3)
        by_gyro[p, :, BIASES] = by_gyro[p, :, own] = -turned[:, 2]
        by_gyro[p, :, own + 1 : own + 3] = turned[:, :2]
        for n, (gyro, axis) in enumerate(PAIRS):
            by_gyro[p, gyro, FIRST_OWN - MISALIGNED + n] = scale_factor[gyro] * felt[axis]
        first = BIASES + HEADING
        by_horizontal[p, :, first : first + ACCELEROMETER] = np.eye(3)
        by_horizontal[p, :, BIASES] = by_horizontal[p, :, own] = -leaning[:, 2]
        by_horizontal[p, :, own + 1 : own + 3] = leaning[:, :2]
    model = np.concatenate((gyros.ravel(), horizontal[level]))
    return model, np.vstack((by_gyro.reshape(-1, len(state)), by_horizontal[level]))
