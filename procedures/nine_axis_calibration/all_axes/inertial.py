"""Accelerometers, boresight, and the gyros' directions to them, in one least-squares fit.

Outputs are b + diag(K)(I + N) f + k2 f^2 with N symmetric, which fixes the frame S; a direction of
the base is seen in S turned by the boresight. Every stand leans a little, within its prior; no
prior is on the sensor, but for a second order that the stands do not determine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.shares import Shares
from procedures.nine_axis_calibration.attitude import rotation
from procedures.nine_axis_calibration.pose import earth_rate

from .channels import Steps
from .stands import FORCE, Array, Mounted, OtherAxes, plane_across
from .waves import (
    SURE,
    Response,
    Wave,
    at_rest,
    response_of,
    swept,
    with_nonlinearity,
    without_rate,
)

WELL_KNOWN_RAD = float(np.radians(0.1))
"""Six arcmin: a direction that is known better counts as known."""
CROSS = ((0, 1), (0, 2), (1, 2))
PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
B, K, N, K2, TURN, M = (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15), 15)
SENSOR = 21
LEANS = SENSOR + 3
FEWEST = 4
UPRIGHT = 0.99
UNKNOWNS_OF_FORCE = 4
"""A gyro's bias, and its sensitivity to the force along each axis."""
NOISE = "noise"
TILT, MOUNTING, EDGE = "prior_tilt", "prior_mounting", "prior_edge"
SECOND_ORDER = "prior_accelerometer_second_order"
"""Rows of the budget: where what the fit rests on comes from."""


@dataclass(frozen=True)
class Orientation:
    """A direction that was felt: nominal `up` (3,), known to `u_rad`, mean force (3,) in g and u,
    NaN of an axis that felt nothing; of a mounting what the gyros read of its turns, and `sigma_g`
    (3,) of a sample of the accelerometers. `source` is the prior that says how well `up` is known.
    """

    name: str
    up: Array
    u_rad: float
    force_g: Array
    force_u: Array
    response: Response | None = None
    source: str = TILT
    sigma_g: Array | None = None


@dataclass(frozen=True)
class Stands:
    """All orientations, and what is known beside them; `second_u` is the prior of the second order
    in g/g^2, None where it is determined, `gyros` whether all were turned with the accelerometers.
    """

    orientations: tuple[Orientation, ...]
    gravity_g: float
    second_u: float | None
    gyros: bool

    @cached_property
    def across(self) -> Array:
        """Two unit vectors across each nominal direction, (s, 2, 3)."""
        return np.array([plane_across(orientation.up) for orientation in self.orientations])

    def directions(self, state: Array) -> Array:
        """Return what points up in S (s, 3) at each stand."""
        nominal = np.array([orientation.up for orientation in self.orientations])
        base = nominal + np.einsum("sk,ski->si", state[LEANS:].reshape(-1, 2), self.across)
        base /= np.linalg.norm(base, axis=1)[:, None]
        return np.asarray(base @ rotation(state[TURN]).T)

    def residuals(self, state: Array) -> Array:
        """Return all residuals in units of their standard uncertainties, as `sources` has them."""
        up = self.directions(state)
        force = self.gravity_g * up
        read = state[B] + state[K] * (force @ shape_of(state).T) + state[K2] * force**2
        measured = np.array([orientation.force_g for orientation in self.orientations])
        u = np.array([orientation.force_u for orientation in self.orientations])
        felt = np.isfinite(u)
        lean_u = np.repeat([orientation.u_rad for orientation in self.orientations], 2)
        parts = [(measured - read)[felt] / u[felt], state[LEANS:] / lean_u]
        if self.second_u:
            parts.append(state[K2] / self.second_u)
        if self.gyros:
            gains = state[SENSOR:LEANS] * (up @ towards_of(state).T)
            for orientation, gain in zip(self.orientations, gains, strict=True):
                if orientation.response is not None:
                    left = (orientation.response.gain - gain) / orientation.response.gain_u
                    parts.append(left[np.isfinite(left)])
        return np.concatenate(parts)

    def sources(self, count: int) -> list[str]:
        """Return what each of `count` residuals is of."""
        felt = sum(int(np.isfinite(orientation.force_u).sum()) for orientation in self.orientations)
        leans = [orientation.source for orientation in self.orientations for _ in range(2)]
        sources = [NOISE] * felt + leans + [SECOND_ORDER] * (3 if self.second_u else 0)
        return sources + [NOISE] * (count - len(sources))


@dataclass(frozen=True)
class Inertial:
    """The solution: state (24 + 2 s,) with its covariance.

    `second_order` says whether that is determined, `wider` by how much uncertainties grew since the
    orientations disagree. `by_second_order` (24 + 2 s, 3) is what the state moves by with a second
    order of each axis that nobody states; zeros where it is stated or determined.
    """

    stands: Stands
    state: Array
    covariance: Array
    second_order: bool
    wider: float
    shares: Shares
    by_second_order: Array

    @property
    def orientations(self) -> tuple[Orientation, ...]:
        """The directions that were felt."""
        return self.stands.orientations

    @property
    def gyros(self) -> bool:
        """Whether all gyros were turned with the accelerometers."""
        return self.stands.gyros

    @property
    def turned(self) -> tuple[bool, ...]:
        """Whether each gyro answered the turns about all three axes."""
        about = np.zeros((3, 3), dtype=bool)
        for orientation in self.orientations:
            if orientation.response is not None:
                axis = int(np.argmax(np.abs(orientation.up)))
                about[axis] |= np.isfinite(orientation.response.gain_u)
        return tuple(bool(about[:, gyro].all()) for gyro in range(3))

    @cached_property
    def up(self) -> Array:
        """What points up in S, (s, 3)."""
        return self.stands.directions(self.state)

    @cached_property
    def up_covariance(self) -> Array:
        """The covariance (3 s, 3 s) of what points up."""
        by_state = _jacobian(lambda state: self.stands.directions(state).ravel(), self.state)
        return np.asarray(by_state @ self.covariance @ by_state.T)

    def force_in_base(self, read_g: Array) -> Array:
        """Return specific forces (n, 3) along the base's axes, in g, from what was read."""
        force = (read_g - self.state[B]) / self.state[K]
        force = (read_g - self.state[B] - self.state[K2] * force**2) / self.state[K]
        turned = np.linalg.solve(shape_of(self.state), force.T).T @ rotation(self.state[TURN])
        return np.asarray(turned)

    def seen_about(self, gyro: int) -> tuple[float, float]:
        """Return the rate about a gyro's own axis over the table's, as its axis was turned; and u.

        The table's axis is not the gyro's: of 3 arcmin 0.4 ppm are lost, and what the misalignment
        brings is as much. One where the gyro's axis was not turned.
        """
        turned = [
            n
            for n, orientation in enumerate(self.orientations)
            if orientation.response is not None and orientation.up[gyro] > UPRIGHT
        ]
        if not turned or not self.gyros:
            return 1.0, 0.0

        def share(state: Array) -> Array:
            up = self.stands.directions(state)[turned].mean(axis=0)
            return np.atleast_1d(up @ towards_of(state)[gyro])

        by_state = _jacobian(share, self.state)[0]
        u = np.sqrt(by_state @ self.covariance @ by_state)
        return float(share(self.state)[0]), float(u)

    @property
    def bias_u_g(self) -> float:
        """The largest standard uncertainty of an accelerometer's bias, in g."""
        return float(np.sqrt(np.max(np.diag(self.covariance)[B])))


def shape_of(state: Array) -> Array:
    """Return I + N (3, 3)."""
    shape = np.eye(3)
    for term, (i, j) in zip(state[N], CROSS, strict=True):
        shape[i, j] = shape[j, i] = term
    return shape


def towards_of(state: Array) -> Array:
    """Return the gyros' input axes (3, 3), a row each."""
    towards = np.eye(3)
    for term, pair in zip(state[M:SENSOR], PAIRS, strict=True):
        towards[pair] = term
    return towards


def orientations_of(data: OtherAxes) -> tuple[tuple[Orientation, ...], Steps]:
    """Return every direction that the sensor stood in, and the steps of the accelerometers."""
    waves, steps = swept(data, FORCE)
    orientations = [
        Orientation(
            rest.name,
            rest.up,
            rest.u_rad,
            *at_rest(rest.acceleration_g, steps),
            source=_source(rest.up, TILT),
        )
        for rest in data.rests
    ]
    orientations += [
        _orientation_of(mounting, waves.get(mounting.name, ()), steps)
        for mounting in data.mountings
    ]
    responses = with_nonlinearity([orientation.response for orientation in orientations])
    return tuple(
        replace(orientation, response=response)
        for orientation, response in zip(orientations, responses, strict=True)
    ), steps


def _orientation_of(mounting: Mounted, waves: Sequence[Wave], steps: Steps) -> Orientation:
    force, u = without_rate(mounting, waves, steps)
    response = response_of(mounting) if np.isfinite(u).any() else None
    source = _source(mounting.up, MOUNTING)
    sigma_g = np.median([wave.sigma for wave in waves], axis=0) if waves else None
    return Orientation(
        mounting.name, mounting.up, mounting.u_rad, force, u, response, source, sigma_g
    )


def _source(up: Array, one_axis: str) -> str:
    """Return which prior says how well a direction is known: another one between axes."""
    return one_axis if np.count_nonzero(np.abs(up) > UPRIGHT) == 1 else EDGE


def ranks(orientations: Sequence[Orientation]) -> tuple[bool, bool]:
    """Return whether the directions that each axis felt determine it, and its second order."""
    first, second = zip(*(_ranks_of(orientations, axis) for axis in range(3)), strict=True)
    return all(first), all(second)


def _ranks_of(orientations: Sequence[Orientation], axis: int) -> tuple[bool, bool]:
    felt = [orientation for orientation in orientations if np.isfinite(orientation.force_u[axis])]
    known = [orientation.up for orientation in felt if orientation.u_rad <= WELL_KNOWN_RAD]
    every = np.array([orientation.up for orientation in felt]).reshape(-1, 3)
    by_direction = np.column_stack((np.ones(len(known)), np.reshape(known, (-1, 3))))
    products = np.column_stack([every[:, i] * every[:, j] for i, j in CROSS])
    by_size = np.column_stack((every, every**2, products))
    first = _rank(by_direction) == FEWEST or _rank(by_size) == by_size.shape[1]
    return first, first and _rank(np.column_stack((by_size, every**3))) == by_size.shape[1] + 3


def _rank(matrix: Array) -> int:
    return int(np.linalg.matrix_rank(matrix, tol=1e-6)) if matrix.size else 0


def solve_inertial(orientations: Sequence[Orientation], data: OtherAxes) -> Inertial | None:
    """Return the fit of what was felt in each direction; gravity and priors are those of `data`.

    None where the directions do not determine the accelerometers.
    """
    first, second = ranks(orientations)
    if not first:
        return None
    responses = [orientation for orientation in orientations if orientation.response is not None]
    gyros = {int(np.argmax(np.abs(orientation.up))) for orientation in responses} == {0, 1, 2}
    second_u = None if second else data.second_order_u
    stands = Stands(tuple(orientations), data.gravity_g, second_u, gyros)
    state = np.zeros(LEANS + 2 * len(orientations))
    state[K], state[SENSOR:LEANS] = 1.0, 1.0
    free = np.ones(len(state), dtype=bool)
    free[K2] = second_u != 0.0
    free[M:LEANS] = gyros

    def residuals(part: Array) -> Array:
        whole = state.copy()
        whole[free] = part
        return stands.residuals(whole)

    scale = np.full(int(free.sum()), 1e-4)
    fit = least_squares(residuals, state[free], x_scale=scale, method="lm", xtol=1e-14)
    state[free] = fit.x
    freedom = len(fit.fun) - int(free.sum())
    square = float(np.sum(fit.fun**2))
    denied = freedom > 0 and chdtrc(freedom, square) < SURE
    wider = float(np.sqrt(square / freedom)) if denied else 1.0
    jacobian = _jacobian(residuals, fit.x)
    covariance = np.zeros((len(state), len(state)))
    covariance[np.ix_(free, free)] = np.linalg.pinv(jacobian.T @ jacobian) * wider**2
    by_row = covariance[:, free] @ jacobian.T / wider
    shares = Shares(by_row, stands.sources(len(fit.fun)))
    by_second_order = np.zeros((len(state), 3))
    if second_u == 0.0:
        by_state = _jacobian(stands.residuals, state)[:, K2]
        by_second_order[free] = -np.linalg.pinv(jacobian) @ by_state
    return Inertial(stands, state, covariance, second, wider, shares, by_second_order)


def _jacobian(function: Callable[[Array], Array], at: Array) -> Array:
    """Return the derivatives of a function (n,) by central differences, (n, k)."""
    steps = 1e-6 * np.eye(len(at))
    return np.column_stack([(function(at + s) - function(at - s)) / 2e-6 for s in steps])


def sensitivities(data: OtherAxes, inertial: Inertial) -> tuple[Array, Array] | None:
    """Return each gyro's sensitivity to specific force (3, 3) in deg/h/g, and u, NaN of none.

    None where the mountings have fewer than four directions. All records of a gyro together: beside
    what grows with the rate, a gain for each mounting, it reads its bias, the earth's rate along
    the table's axis, the force, and what grows with the magnitude of its own rate. That one is a
    gyro's own: mountings of several rates give it for those of one.
    """
    mounted = [
        (orientation.response, orientation.up, up)
        for orientation, up in zip(inertial.orientations, inertial.up, strict=True)
        if orientation.response is not None
    ]
    nominal = np.reshape([nominal for _, nominal, _ in mounted], (-1, 3))
    if _rank(np.column_stack((np.ones(len(nominal)), nominal))) < UNKNOWNS_OF_FORCE:
        return None
    value, u = np.full((3, 3), np.nan), np.full((3, 3), np.nan)
    for gyro in range(3):
        solved = _sensitivity(data, [(response, up) for response, _, up in mounted], gyro)
        if solved is not None:
            value[gyro], u[gyro] = solved
    return value, u


def _sensitivity(
    data: OtherAxes, mounted: Sequence[tuple[Response, Array]], gyro: int
) -> tuple[Array, Array] | None:
    """Return the sensitivities (3,) of a gyro, and u; None where its records determine none."""
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
    every = np.arange(weighted.shape[1])
    # At one rate only an asymmetry is the same in all mountings: it is in the bias.
    for keep in (every, every[every != UNKNOWNS_OF_FORCE]):
        if np.linalg.matrix_rank(weighted[:, keep], tol=1e-6) == len(keep):
            inverse = np.linalg.inv(weighted[:, keep].T @ weighted[:, keep])
            solved = inverse @ (weighted[:, keep].T @ (np.array(read) / np.array(size)))
            own = slice(1, UNKNOWNS_OF_FORCE)
            return (solved / scale[keep])[own], (np.sqrt(np.diag(inverse)) / scale[keep])[own]
    return None
