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

from procedures.estimation.shares import Shares
from procedures.nine_axis_calibration.attitude import rotation
from procedures.nine_axis_calibration.dataset import TurnRecord
from procedures.nine_axis_calibration.means import rounding_u

from .channels import Steps
from .response import Response, response_of, with_nonlinearity
from .sources import EDGE, MOUNTING, NOISE, SECOND_ORDER, TILT
from .stands import Array, Mounted, OtherAxes, plane_across
from .waves import at_rest, steps_at, waves_of, without_rate

WELL_KNOWN_RAD = float(np.radians(0.1))
"""Six arcmin: a direction that is known better counts as known."""
SURE = 1e-3
CROSS = ((0, 1), (0, 2), (1, 2))
PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
B, K, N, K2, TURN, M = (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15), 15)
SENSOR = 21
FEWEST = 4
UPRIGHT = 0.99


@dataclass(frozen=True)
class Orientation:
    """A direction that was felt: nominal `up` (3,), known to `u_rad`, mean force (3,) in g and u,
    NaN of an axis that felt nothing; of a mounting what the gyros read of its turns. `source` is
    the prior that says how well `up` is known."""

    name: str
    up: Array
    u_rad: float
    force_g: Array
    force_u: Array
    response: Response | None = None
    source: str = TILT


@dataclass(frozen=True)
class Inertial:
    """The solution: state (21 + 2 s,), covariance, directions `up` (s, 3) of orientations in S and
    their derivatives `up_by_state` (3 s, 21 + 2 s).

    `determined` says whether bias, scale factor and non-orthogonality are, `second_order` whether
    that is, `gyros` whether all gyros were turned with the accelerometers. `wider` is by how much
    uncertainties grew since the orientations disagree.
    """

    orientations: tuple[Orientation, ...]
    state: Array
    covariance: Array
    up: Array
    up_by_state: Array
    determined: bool
    second_order: bool
    gyros: bool
    wider: float
    shares: Shares

    @property
    def turned(self) -> tuple[bool, bool, bool]:
        """Whether each gyro answered the turns about all three axes."""
        about: dict[int, list[Array]] = {0: [], 1: [], 2: []}
        for orientation in self.orientations:
            if orientation.response is not None:
                axis = int(np.argmax(np.abs(orientation.up)))
                about[axis].append(np.isfinite(orientation.response.gain_u))
        seen = [np.any(own, axis=0) if own else np.zeros(3, dtype=bool) for own in about.values()]
        x, y, z = np.all(seen, axis=0).tolist()
        return x, y, z

    @property
    def up_covariance(self) -> Array:
        """The covariance (3 s, 3 s) of what points up."""
        return np.asarray(self.up_by_state @ self.covariance @ self.up_by_state.T)

    def force_in_base(self, read_g: Array) -> Array:
        """Return specific forces (n, 3) along the base's axes, in g, from what was read."""
        shape = np.eye(3)
        for term, (i, j) in zip(self.state[N], CROSS, strict=True):
            shape[i, j] = shape[j, i] = term
        force = (read_g - self.state[B]) / self.state[K]
        force = (read_g - self.state[B] - self.state[K2] * force**2) / self.state[K]
        return np.asarray(np.linalg.solve(shape, force.T).T @ rotation(self.state[TURN]))

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
        count = len(self.state)
        slope, share = np.zeros(count + 3 * len(self.orientations)), 0.0
        own = [(place, other) for place, (row, other) in enumerate(PAIRS) if row == gyro]
        for n in turned:
            share += self.up[n][gyro] / len(turned)
            slope[count + 3 * n + gyro] = 1.0 / len(turned)
            for place, other in own:
                lean = self.state[M + place]
                share += lean * self.up[n][other] / len(turned)
                slope[M + place] += self.up[n][other] / len(turned)
                slope[count + 3 * n + other] = lean / len(turned)
        by_state = slope[:count] + slope[count:] @ self.up_by_state
        return float(share), float(np.sqrt(by_state @ self.covariance @ by_state))

    @property
    def bias_u_g(self) -> float:
        """The largest standard uncertainty of an accelerometer's bias, in g."""
        return float(np.sqrt(np.max(np.diag(self.covariance)[B])))


def orientations_of(data: OtherAxes) -> tuple[tuple[Orientation, ...], Steps]:
    """Return every direction that the sensor stood in, and the steps of the accelerometers."""
    steps = steps_at(data, "acceleration_g")
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
    orientations += [_orientation_of_mounting(mounting, steps) for mounting in data.mountings]
    responses = with_nonlinearity([orientation.response for orientation in orientations])
    return tuple(
        replace(orientation, response=response)
        for orientation, response in zip(orientations, responses, strict=True)
    ), steps


def _orientation_of_mounting(mounting: Mounted, steps: Steps) -> Orientation:
    samples = [
        np.column_stack((record.turn.rate_deg_per_s, _or_none(record.acceleration_g, record.turn)))
        for record in mounting.records
    ]
    rounding = np.zeros(3)
    waves = waves_of(mounting, samples)
    for gyro in range(3):
        columns = [own[np.isfinite(own[:, gyro]), gyro] for own in samples]
        values = np.concatenate([*columns, np.zeros(0)])
        if not len(values) or float(np.ptp(values)) == 0.0:
            rounding[gyro] = np.nan  # What never changes has measured nothing of the turns.
            continue
        noise = [wave.sigma[gyro] ** 2 for wave in waves if np.isfinite(wave.sigma[gyro])]
        rounding[gyro] = rounding_u(columns, float(np.mean(noise))) if noise else np.nan
    force, u = without_rate(mounting, waves, 3, steps)
    response = response_of(waves, rounding) if np.isfinite(u).any() else None
    source = _source(mounting.up, MOUNTING)
    return Orientation(mounting.name, mounting.up, mounting.u_rad, force, u, response, source)


def _source(up: Array, one_axis: str) -> str:
    """Return which prior says how well a direction is known: another one between axes."""
    return one_axis if np.count_nonzero(np.abs(up) > UPRIGHT) == 1 else EDGE


def _or_none(samples: Array | None, turn: TurnRecord) -> Array:
    return np.full((len(turn.time_s), 3), np.nan) if samples is None else samples


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
    by_row = covariance[:, free] @ jacobian.T / wider
    up = _directions(whole, orientations, across)
    by_state = _jacobian(lambda x: _directions(x, orientations, across).ravel(), whole)
    return Inertial(
        tuple(orientations),
        whole,
        covariance,
        up,
        by_state,
        first,
        second,
        gyros,
        wider,
        Shares(by_row, _sources(orientations, second_u, len(fit.fun))),
    )


def _sources(orientations: Sequence[Orientation], second_u: float | None, count: int) -> list[str]:
    """Return what each residual is of, in the order of `_residuals`."""
    felt = sum(int(np.isfinite(orientation.force_u).sum()) for orientation in orientations)
    leans = [orientation.source for orientation in orientations for _ in range(2)]
    sources = [NOISE] * felt + leans + [SECOND_ORDER] * (3 if second_u else 0)
    return sources + [NOISE] * (count - len(sources))


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
    felt = np.isfinite(u)
    lean = state[SENSOR + 3 :].reshape(-1, 2)
    parts = [
        ((measured - read)[felt] / u[felt]),
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
