"""Accelerometers, boresight, and the gyros' directions to them, in one least-squares fit.

Outputs are b + diag(K)(I + N) f + k2 f^2 with N symmetric, which fixes the frame S; a direction of
the base is seen in S turned by the boresight. Every stand leans a little, within its prior; no
prior is on the sensor, but for a second order that the stands do not determine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc

from procedures.nine_axis_calibration.attitude import rotation

from .response import Response, response_of, with_nonlinearity
from .stands import Array, Mounted, OtherAxes, Rest, plane_across
from .waves import at_rest, waves_of, without_rate

WELL_KNOWN_RAD = float(np.radians(0.1))
"""Six arcmin: a direction that is known better counts as known."""
SURE = 1e-3
CROSS = ((0, 1), (0, 2), (1, 2))
PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
B, K, N, K2, TURN, M = (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15), 15)
SENSOR = 21
FEWEST = 4


@dataclass(frozen=True)
class Orientation:
    """A direction that was felt: nominal `up` (3,), known to `u_rad`, mean force (3,) in g and u;
    of a mounting what the gyros read of its turns."""

    name: str
    up: Array
    u_rad: float
    force_g: Array
    force_u: Array
    response: Response | None = None


@dataclass(frozen=True)
class Inertial:
    """The solution: state (21 + 2 s,), covariance, directions `up` (s, 3) of orientations in S.

    `determined` says whether bias, scale factor and non-orthogonality are, `second_order` whether
    that is, `gyros` whether all gyros were turned with the accelerometers. `wider` is by how much
    uncertainties grew since the orientations disagree.
    """

    orientations: tuple[Orientation, ...]
    state: Array
    covariance: Array
    up: Array
    up_covariance: Array
    determined: bool
    second_order: bool
    gyros: bool
    wider: float

    def force_in_base(self, read_g: Array) -> Array:
        """Return specific forces (n, 3) along the base's axes, in g, from what was read."""
        shape = np.eye(3)
        for term, (i, j) in zip(self.state[N], CROSS, strict=True):
            shape[i, j] = shape[j, i] = term
        force = (read_g - self.state[B]) / self.state[K]
        force = (read_g - self.state[B] - self.state[K2] * force**2) / self.state[K]
        return np.asarray(np.linalg.solve(shape, force.T).T @ rotation(self.state[TURN]))

    @property
    def bias_u_g(self) -> float:
        """The largest standard uncertainty of an accelerometer's bias, in g."""
        return float(np.sqrt(np.max(np.diag(self.covariance)[B])))


def orientations_of(data: OtherAxes) -> tuple[Orientation, ...]:
    """Return every direction in which accelerometers were recorded."""
    orientations = [
        *map(_orientation_of_rest, data.rests),
        *map(_orientation_of_mounting, data.with_acceleration),
    ]
    responses = with_nonlinearity([orientation.response for orientation in orientations])
    return tuple(
        replace(orientation, response=response)
        for orientation, response in zip(orientations, responses, strict=True)
        if np.isfinite(orientation.force_g).all() and (orientation.force_u > 0).all()
    )


def _orientation_of_rest(rest: Rest) -> Orientation:
    return Orientation(rest.name, rest.up, rest.u_rad, *at_rest(rest, rest.acceleration_g))


def _orientation_of_mounting(mounting: Mounted) -> Orientation:
    samples = [
        np.column_stack((record.turn.rate_deg_per_s, _there(record.acceleration_g)))
        for record in mounting.records
    ]
    waves = waves_of(mounting, samples)
    force, covariance = without_rate(mounting, waves, 3)
    u = np.sqrt(np.diag(covariance))
    return Orientation(mounting.name, mounting.up, mounting.u_rad, force, u, response_of(waves))


def _there(samples: Array | None) -> Array:
    assert samples is not None
    return samples


def ranks(orientations: Sequence[Orientation]) -> tuple[bool, bool]:
    """Return whether the nominal directions determine the first order, and the second."""
    known = np.array(
        [orientation.up for orientation in orientations if orientation.u_rad <= WELL_KNOWN_RAD]
    ).reshape(-1, 3)
    every = np.array([orientation.up for orientation in orientations]).reshape(-1, 3)
    by_direction = np.column_stack((np.ones(len(known)), known))
    products = np.column_stack([every[:, i] * every[:, j] for i, j in CROSS])
    by_size = np.column_stack((every, every**2, products))
    first = _rank(by_direction) == FEWEST or _rank(by_size) == by_size.shape[1]
    return first, first and _rank(np.column_stack((by_size, every**3))) == by_size.shape[1] + 3


def _rank(matrix: Array) -> int:
    return int(np.linalg.matrix_rank(matrix, tol=1e-6)) if matrix.size else 0


def solve_inertial(data: OtherAxes) -> Inertial | None:
    """Return the fit; None where the directions do not determine the accelerometers."""
    return solve_orientations(orientations_of(data), data)


def solve_orientations(orientations: Sequence[Orientation], data: OtherAxes) -> Inertial | None:
    """Return the fit of what was felt in each direction; gravity and priors are those of `data`."""
    first, second = ranks(orientations)
    if not first:
        return None
    across = np.array([plane_across(orientation.up) for orientation in orientations])
    responses = [orientation for orientation in orientations if orientation.response is not None]
    gyros = {int(np.argmax(np.abs(orientation.up))) for orientation in responses} == {0, 1, 2}
    state = np.zeros(SENSOR + 3 + 2 * len(orientations))
    state[K], state[SENSOR : SENSOR + 3] = 1.0, 1.0
    second_u = data.second_order_u if not second else None
    free = _free(state, second_u, gyros=gyros)

    def residuals(part: Array) -> Array:
        whole = state.copy()
        whole[free] = part
        return _residuals(whole, orientations, across, data, second_u, gyros=gyros)

    scale = np.full(len(state), 1e-4)
    fit = least_squares(residuals, state[free], x_scale=scale[free], method="lm", xtol=1e-14)
    whole = state.copy()
    whole[free] = fit.x
    freedom = len(fit.fun) - int(free.sum())
    square = float(np.sum(fit.fun**2))
    wider = 1.0
    if freedom > 0 and chdtrc(freedom, square) < SURE:
        wider = float(np.sqrt(square / freedom))
    jacobian = _jacobian(residuals, fit.x)
    covariance = np.zeros((len(state), len(state)))
    covariance[np.ix_(free, free)] = np.linalg.pinv(jacobian.T @ jacobian) * wider**2
    up = _directions(whole, orientations, across)
    by_state = _jacobian(lambda x: _directions(x, orientations, across).ravel(), whole)
    return Inertial(
        tuple(orientations),
        whole,
        covariance,
        up,
        by_state @ covariance @ by_state.T,
        first,
        second,
        gyros,
        wider,
    )


def _free(state: Array, second_u: float | None, *, gyros: bool) -> NDArray[np.bool_]:
    """Return which unknowns are solved for."""
    free = np.ones(len(state), dtype=bool)
    if second_u == 0.0:
        free[K2] = False
    if not gyros:
        free[M : SENSOR + 3] = False
    return free


def _directions(state: Array, orientations: Sequence[Orientation], across: Array) -> Array:
    """Return what points up in S (s, 3) at each stand."""
    lean = state[SENSOR + 3 :].reshape(-1, 2)
    base = np.array([orientation.up for orientation in orientations]) + np.einsum(
        "sk,ski->si", lean, across
    )
    base /= np.linalg.norm(base, axis=1)[:, None]
    return np.asarray(base @ rotation(state[TURN]).T)


def _residuals(
    state: Array,
    orientations: Sequence[Orientation],
    across: Array,
    data: OtherAxes,
    second_u: float | None,
    *,
    gyros: bool,
) -> Array:
    """Return all residuals in units of their standard uncertainties."""
    up = _directions(state, orientations, across)
    force = data.gravity_g * up
    shape = np.eye(3)
    for term, (i, j) in zip(state[N], CROSS, strict=True):
        shape[i, j] = shape[j, i] = term
    read = state[B] + state[K] * (force @ shape.T) + state[K2] * force**2
    measured = np.array([orientation.force_g for orientation in orientations])
    u = np.array([orientation.force_u for orientation in orientations])
    lean = state[SENSOR + 3 :].reshape(-1, 2)
    parts = [
        ((measured - read) / u).ravel(),
        (lean / [[orientation.u_rad] for orientation in orientations]).ravel(),
    ]
    if second_u:
        parts.append(state[K2] / second_u)
    if gyros:
        towards = np.eye(3)
        for term, (i, j) in zip(state[M:SENSOR], PAIRS, strict=True):
            towards[i, j] = term
        for orientation, direction in zip(orientations, up, strict=True):
            if orientation.response is not None:
                gain = state[SENSOR : SENSOR + 3] * (towards @ direction)
                left = (orientation.response.gain - gain) / orientation.response.gain_u
                parts.append(left[np.isfinite(left)])
    return np.concatenate(parts)


def _jacobian(function: Callable[[Array], Array], at: Array) -> Array:
    """Return the derivatives of a function (n,) by central differences, (n, k)."""
    columns = []
    for n in range(len(at)):
        step = np.zeros(len(at))
        step[n] = 1e-6
        columns.append((function(at + step) - function(at - step)) / 2e-6)
    return np.column_stack(columns)
