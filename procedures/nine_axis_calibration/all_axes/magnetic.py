"""The magnetometer in the earth's field: offset, scale factors and directions, from its turns.

Outputs are o + A (n Z + c cos theta - (n x c) sin theta), c across n and H long, F^2 = H^2 + Z^2:
n is what points up, theta the table's angle. A stand at rest is one of them at an unknown heading.
The table's axis leans a little from the vertical, which moves H and Z of all turns alike, and of no
stand at rest. A field fixed to what turns is the same in all turns of a mounting: with north at the
encoder's zero it has three components for all mountings, and none at a stand beside the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc, fdtrc

from procedures.estimation.shares import Shares

from .channels import Steps
from .inertial import NOISE, TILT, Inertial
from .stands import FIELD, Array, Mounted, OtherAxes, plane_across
from .waves import SURE, WHITE, Wave, at_rest, swept

O, A, F, I, AXIS = slice(0, 3), slice(3, 12), 12, 13, 14  # noqa: E741
PLATFORM = slice(15, 18)
SENSOR = 18
RESULTS = 12
DIRECTIONS = "prior_directions"
MAGNITUDE, INCLINATION = "prior_earth_field_magnitude", "prior_earth_field_inclination"
"""Rows of the budget: where what the fit rests on comes from."""
FIELD_SCALE_NT = 50_000.0
"""Unknowns of the field are in units of it, so that all are about one."""
SMALLEST = 1e-9
FREE = 1e-11
"""Of the normal matrix with a diagonal of ones: a smaller eigenvalue is a direction that nothing
determines."""
HALVINGS, SETTLED = 24, 0.03
MOVED = 1e-3
MAX_U = 0.02
"""Of the field: where a result is less certain the solution is not straight enough for its u."""
AZIMUTHS = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)[:, None]
MAX_STEPS = 200
"""Of the search, which takes thirty where the directions determine everything."""


@dataclass(frozen=True)
class Felt:
    """What a magnetometer felt of one direction: mean, cosine and sine (3, 3) in nT, covariance
    (9, 9); of a stand at rest the mean alone, the others NaN. `up` (3,), `place` in its list."""

    name: str
    wave: Array
    covariance: Array
    up: Array
    turned: bool


@dataclass(frozen=True)
class Magnetic:
    """Offset (3,) in nT, matrix `gain` (3, 3), covariance (12, 12) of both, row by row.

    `undetermined` (12, m) are the directions in which nothing determines them. `relative` says that
    no field was known: gains have mean one. `delay_s` (3,) is how late each axis answers.
    `wander_nT` is by how much the field differs from record to record beyond noise, `freedom` what
    is left to see it by. `platform_nT` (3,) is a field fixed to what turns, along north at the
    encoder's zero, along west, and up; zero where the turns do not ask for one.
    """

    offset_nT: Array
    gain: Array
    covariance: Array
    undetermined: Array
    relative: bool
    wander_nT: float
    freedom: float
    field_nT: float
    inclination_deg: float
    delay_s: Array
    platform_nT: Array
    stands_left_out: bool
    shares: Shares

    def determines(self, slope: Array) -> bool:
        """Whether a result with these derivatives (12,) by offset and gain is determined."""
        return bool(np.all(np.abs(slope @ self.undetermined) < MOVED * np.linalg.norm(slope)))

    @property
    def whole(self) -> bool:
        """Whether offset and matrix are determined."""
        return all(map(self.determines, np.eye(RESULTS)))

    @property
    def knows_offset(self) -> bool:
        """Whether the offset is determined."""
        return all(map(self.determines, np.eye(RESULTS)[O]))

    @property
    def disturbed(self) -> bool:
        """Whether a field turned with the sensor."""
        return bool(self.platform_nT.any())


@dataclass(frozen=True)
class _Fit:
    """A solution: its state, which unknowns were free, the jacobian by those, chi-square and the
    number of residuals."""

    state: Array
    free: NDArray[np.bool_]
    jacobian: Array
    square: float
    count: int

    @cached_property
    def spectrum(self) -> tuple[Array, Array, Array]:
        """Scale (k,) of the free unknowns, eigenvalues and vectors of their normal matrix by it."""
        normal = self.jacobian.T @ self.jacobian
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        return scale, *np.linalg.eigh(normal / np.outer(scale, scale))

    @property
    def rank(self) -> int:
        """How many combinations of the free unknowns are determined."""
        return int(np.sum(self.spectrum[1] > FREE))

    @property
    def freedom(self) -> int:
        """How many residuals are more than they need."""
        return self.count - self.rank

    @property
    def agrees(self) -> bool:
        """Whether noise explains what is left."""
        return self.freedom < 1 or float(chdtrc(self.freedom, self.square)) >= SURE

    def covariance(self) -> tuple[Array, Array]:
        """Return the covariance of the state, and the directions in which nothing determines it."""
        scale, values, vectors = self.spectrum
        sure = values > FREE
        inverse = (vectors[:, sure] / values[sure]) @ vectors[:, sure].T / np.outer(scale, scale)
        covariance = np.zeros((len(self.state), len(self.state)))
        covariance[np.ix_(self.free, self.free)] = inverse
        unknown = np.zeros((len(self.state), int(np.sum(~sure))))
        unknown[self.free] = vectors[:, ~sure] / scale[:, None]
        undetermined = np.column_stack((unknown, np.eye(len(self.state))[:, ~self.free]))
        return covariance, undetermined / np.linalg.norm(undetermined, axis=0)


def felt_of(data: OtherAxes) -> tuple[list[Felt], Array, Steps]:
    """Return what was felt in every direction, delay of each axis in s (3,), the steps of each."""
    by_mounting, steps = swept(data, FIELD)
    mounted = [
        (mounting, [w for w in by_mounting.get(mounting.name, ()) if np.isfinite(w.value).any()])
        for mounting in data.mountings
    ]
    delay_s = _delay([waves for _, waves in mounted])
    felt = [_averaged(mounting, waves, delay_s, steps) for mounting, waves in mounted if waves]
    for rest in data.rests:
        if rest.field_nT is not None:
            wave = np.full((3, 3), np.nan)
            wave[0], u = at_rest(rest.field_nT, steps)
            felt.append(Felt(rest.name, wave, np.diag(np.tile(u**2, 3)), rest.up, turned=False))
    some = [direction for direction in felt if np.isfinite(direction.wave[0]).any()]
    return some, delay_s, steps


def _delay(mounted: Sequence[Sequence[Wave]]) -> Array:
    """Return how late each axis answers: its wave is behind by that times the rate, either way."""
    delay, weight = np.zeros(3), np.full(3, 1e-12)
    for waves in mounted:
        rates = np.array([wave.rate_rad_per_s for wave in waves])
        complex_ = np.array([wave.value[1] + 1j * wave.value[2] for wave in waves])
        for size in np.unique(np.round(np.abs(rates), 3)):
            own = np.isclose(np.abs(rates), size, atol=2e-3)
            forth, back = own & (rates > 0.0), own & (rates < 0.0)
            if not (bool(forth.any()) and bool(back.any())):
                continue
            ahead = complex_[forth].mean(axis=0) * np.conj(complex_[back].mean(axis=0))
            ahead = np.nan_to_num(ahead)
            share = size**2 * np.abs(ahead)
            delay += share * np.angle(ahead) / (2.0 * size)
            weight += share
    return np.asarray(delay / weight)


def _averaged(mounting: Mounted, waves: Sequence[Wave], delay_s: Array, steps: Steps) -> Felt:
    """Return the wave of a mounting, both senses alike: what goes with the rate drops out.

    An axis that a sense does not have is NaN. What the steps leave does not average out.
    """
    senses = []
    for sign in (1.0, -1.0):
        own = [wave for wave in waves if np.sign(wave.rate_rad_per_s) == sign]
        if own:
            senses.append(_weighted(own, delay_s, steps))
    value = np.mean([wave for wave, _ in senses], axis=0)
    covariance = np.sum([share for _, share in senses], axis=0) / len(senses) ** 2
    covariance += np.diag(np.kron([1.0, 2.0, 2.0], steps.rounding**2))
    return Felt(mounting.name, value, covariance, mounting.up, turned=True)


def _weighted(waves: Sequence[Wave], delay_s: Array, steps: Steps) -> tuple[Array, Array]:
    """Return the mean wave (3, 3) of one sense, records weighted by their length; covariance."""
    length = np.array([1.0 / max(float(wave.inverse[0, 0]), SMALLEST) for wave in waves])
    # What never changes has measured nothing.
    noisy = [np.maximum(wave.sigma, steps.step) > 0.0 for wave in waves]
    there = np.array([np.isfinite(wave.value[0]) for wave in waves]) & np.array(noisy)
    shares = there * length[:, None]
    total = shares.sum(axis=0)
    value, covariance = np.zeros((3, 3)), np.zeros((9, 9))
    for share, wave in zip(shares, waves, strict=True):
        weights = share / np.where(total > 0.0, total, np.nan)
        turned = (wave.value[1] + 1j * wave.value[2]) * np.exp(-1j * delay_s * wave.rate_rad_per_s)
        shifted = np.array([wave.value[0], turned.real, turned.imag])
        value += np.where(share > 0.0, weights * shifted, np.where(total > 0.0, 0.0, np.nan))
        sigma = np.nan_to_num(weights * np.maximum(wave.sigma, WHITE * steps.step))
        covariance += np.kron(wave.inverse, np.diag(sigma**2))
    return value, covariance


def solve_magnetic(
    felt: Sequence[Felt], delay_s: Array, data: OtherAxes, inertial: Inertial | None
) -> Magnetic | None:
    """Return the magnetometer's offset and matrix; None where the directions determine neither.

    Where the records deny one common field (chi-square at 99.9 %), a field fixed to what turns is
    solved for if that explains it (F test at 99.9 %): the stands are beside it, or where they deny
    that, are left out. What is left then is given to every record as a variance of its own.
    """
    if not any(direction.turned for direction in felt):
        return None
    model = _model_of(felt, data, inertial)
    fit = model.best()
    if _weak(fit.covariance()[0]):
        return None
    stands_left_out, seen = False, model
    if not fit.agrees:
        beside = model.fitted(fit.state, platform=True)
        if _explains(fit, beside):
            fit = beside
        if not fit.agrees and len(model.felt) > len(model.turns):
            turns = _model_of(model.turns, data, inertial)
            alone = turns.best()
            with_field = turns.fitted(alone.state, platform=True)
            if with_field.agrees and not alone.agrees and _explains(alone, with_field):
                fit, seen, stands_left_out = with_field, turns, True
    wander_nT = 0.0
    if not fit.agrees:
        wander_nT, fit = seen.wandering(fit)
    covariance, undetermined = fit.covariance()
    if _weak(covariance):
        return None
    size_nT = model.size_nT
    units = np.concatenate((np.full(3, size_nT), np.ones(9)))
    field = slice(0, RESULTS)
    by_row = units[:, None] * (covariance[field][:, fit.free] @ fit.jacobian.T)
    return Magnetic(
        fit.state[O] * size_nT,
        fit.state[A].reshape(3, 3),
        covariance[field, field] * np.outer(units, units),
        undetermined[field],
        data.field_nT is None,
        wander_nT,
        float(fit.freedom) if wander_nT else np.inf,
        float(fit.state[F] * size_nT),
        float(np.degrees(fit.state[I])),
        delay_s,
        fit.state[PLATFORM] * size_nT,
        stands_left_out,
        Shares(by_row, seen.sources(len(fit.jacobian))),
    )


def _weak(covariance: Array) -> bool:
    """Return whether a result is so uncertain that the solution is not straight enough for it."""
    return float(np.sqrt(np.max(np.diag(covariance)[:RESULTS]))) > MAX_U


def _explains(fit: _Fit, wider: _Fit) -> bool:
    """Return whether unknowns more explain what noise does not, by the F test at 99.9 %."""
    more = wider.rank - fit.rank
    freedom = fit.freedom - more
    if more < 1 or freedom < 1:
        return False
    ratio = (fit.square - wider.square) / more / max(wider.square / freedom, 1e-300)
    return ratio > 0.0 and float(fdtrc(more, freedom, ratio)) < SURE


@dataclass(frozen=True)
class _Model:
    """What was felt, and what is known of how it stood.

    `up` (f, 3), the root (2 f, 2 f) of the covariance of how it leans along `across` (f, 2, 3), the
    axis `apart` (f, 3) that azimuths count from; `measured` (f, 9) of which `there` (f, 9) says
    what each axis felt, `roots` (f, 9, 9) of their inverse covariances.
    """

    felt: Sequence[Felt]
    up: Array
    up_root: Array
    across: Array
    apart: Array
    turned: NDArray[np.bool_]
    measured: Array
    there: NDArray[np.bool_]
    roots: Array
    data: OtherAxes
    size_nT: float

    def sources(self, count: int) -> list[str]:
        """Return what each of `count` residuals is of, in the order of `_residuals`."""
        stated = [MAGNITUDE] if self.data.field_nT is not None else [NOISE]
        stated += [INCLINATION] if self.data.inclination_rad is not None else []
        sources = [DIRECTIONS] * (2 * len(self.felt)) + [TILT]
        sources += [NOISE] * int(self.there.sum()) + stated
        return sources + [NOISE] * (count - len(sources))

    @property
    def turns(self) -> list[Felt]:
        """What was felt in turns."""
        return [direction for direction in self.felt if direction.turned]

    def best(self) -> _Fit:
        """Return the best solution without a field of the platform.

        Outputs that are all inverted look like a field of the other inclination: only where that is
        stated does such a solution differ, and it counts where noise explains what it leaves.
        """
        fit = self.fitted(_start(self, 1.0))
        if fit.agrees or self.data.inclination_rad is None:
            return fit
        inverted = self.fitted(_start(self, -1.0))
        return inverted if inverted.agrees else fit

    def fitted(self, start: Array, *, platform: bool = False) -> _Fit:
        """Return the best solution near a beginning, with a field of the platform or without."""
        state = start.copy()
        free = np.ones(len(state), dtype=bool)
        free[PLATFORM] = platform
        # An axis that felt nothing stays ideal.
        dead = ~self.there[:, :3].any(axis=0)
        free[O] = ~dead
        free[A] = np.repeat(~dead, 3)

        def residuals(part: Array) -> Array:
            state[free] = part
            left = _residuals(state, self)
            return np.pad(left, (0, max(len(part) - len(left), 0)))

        exact = {"xtol": 1e-13, "ftol": 1e-13, "gtol": 1e-13}
        fit = least_squares(residuals, state[free], method="lm", max_nfev=MAX_STEPS, **exact)
        state[free] = fit.x
        return _Fit(state, free, fit.jac, 2.0 * float(fit.cost), len(_residuals(state, self)))

    def wandering(self, fit: _Fit) -> tuple[float, _Fit]:
        """Return what each record's field differs by in nT, so that noise explains the rest."""
        platform = bool(fit.free[PLATFORM].any())
        low, high = 0.0, float(np.sqrt(fit.square)) * self._noise_nT
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            fit = self._with(middle).fitted(fit.state, platform=platform)
            low, high = (middle, high) if fit.square > fit.freedom else (low, middle)
            if high - low < SETTLED * high:
                break
        return high, fit

    @property
    def _noise_nT(self) -> float:
        return max(float(np.sqrt(np.max(np.diag(row.covariance)[:3]))) for row in self.felt)

    def _with(self, wander_nT: float) -> _Model:
        """Return the model of records that each have a variance more."""
        felt = [
            replace(row, covariance=row.covariance + wander_nT**2 * np.eye(9)) for row in self.felt
        ]
        return replace(self, felt=felt, roots=_roots(felt))


def _model_of(felt: Sequence[Felt], data: OtherAxes, inertial: Inertial | None) -> _Model:
    up, up_root = _known_up(felt, data, inertial)
    measured = np.array([direction.wave.ravel() for direction in felt])
    return _Model(
        felt,
        up,
        up_root,
        np.array([plane_across(direction) for direction in up]),
        np.eye(3)[np.argmin(np.abs(up), axis=1)],
        np.array([direction.turned for direction in felt]),
        measured,
        np.isfinite(measured),
        _roots(felt),
        data,
        data.field_nT or FIELD_SCALE_NT,
    )


def _known_up(
    felt: Sequence[Felt], data: OtherAxes, inertial: Inertial | None
) -> tuple[Array, Array]:
    """Return what points up (f, 3), and the root (2 f, 2 f) of the covariance of how it leans.

    From the accelerometers where they are determined; else nominal, within the prior.
    """
    count = len(felt)
    up = np.array([direction.up for direction in felt])
    covariance = np.zeros((2 * count, 2 * count))
    if inertial is None:
        sizes = {rest.name: rest.u_rad for rest in data.rests}
        sizes |= {mounting.name: mounting.u_rad for mounting in data.mountings}
        covariance = np.diag(np.repeat([sizes[direction.name] ** 2 for direction in felt], 2))
    else:
        places = {orientation.name: n for n, orientation in enumerate(inertial.orientations)}
        pick = np.zeros((2 * count, 3 * len(inertial.orientations)))
        for n, direction in enumerate(felt):
            place = places[direction.name]
            up[n] = inertial.up[place]
            pick[2 * n : 2 * n + 2, 3 * place : 3 * place + 3] = plane_across(up[n])
        covariance = pick @ inertial.up_covariance @ pick.T
    values, vectors = np.linalg.eigh(covariance)
    return up, vectors * np.sqrt(np.maximum(values, 0.0))


def _roots(felt: Sequence[Felt]) -> Array:
    """Return roots (f, 9, 9) of the inverse covariances, zero for what an axis did not feel."""
    roots = np.zeros((len(felt), 9, 9))
    for n, direction in enumerate(felt):
        there = np.flatnonzero(np.isfinite(direction.wave.ravel()))
        own = np.ix_(there, there)
        covariance = direction.covariance[own] + SMALLEST * np.eye(len(there))
        roots[n][own] = np.linalg.inv(np.linalg.cholesky(covariance))
    return roots


def _start(model: _Model, sense: float) -> Array:
    """Return where the search begins: an ideal sensor, or with a `sense` of -1 one whose outputs
    are all inverted, and the offset that the means leave; of an unknown inclination the sign that
    leaves less of them."""
    felt, up, data = model.felt, model.up, model.data
    field_nT = model.size_nT
    state = np.zeros(SENSOR + 3 * len(felt))
    waves = np.nan_to_num([direction.wave[1:] for direction in model.turns])
    across_nT = float(np.mean(np.linalg.norm(waves, axis=(1, 2)))) / np.sqrt(2.0)
    angle = data.inclination_rad
    if angle is None:
        size = float(np.arccos(min(across_nT / field_nT, 0.999)))
        angle = min(size, -size, key=lambda way: _offset(model, -field_nT * np.sin(way))[1])
    level_nT, upwards_nT = field_nT * np.cos(angle), -sense * field_nT * float(np.sin(angle))
    offset = _offset(model, upwards_nT)[0]
    state[A], state[F], state[I] = sense * np.eye(3).ravel(), 1.0, angle
    state[O] = offset / field_nT
    for n, direction in enumerate(felt):
        first, second = plane_across(up[n])
        north = sense * (np.cos(AZIMUTHS) * first + np.sin(AZIMUTHS) * second)
        if direction.turned:
            seen = direction.wave[1] - across_nT * north
            behind = direction.wave[2] + across_nT * np.cross(up[n], north)
            apart = np.nansum(seen**2, axis=1) + np.nansum(behind**2, axis=1)
        else:
            seen = direction.wave[0] - offset - upwards_nT * up[n] - level_nT * north
            apart = np.nansum(seen**2, axis=1)
        state[SENSOR + n] = AZIMUTHS[int(np.argmin(apart)), 0]
    return state


def _offset(model: _Model, upwards_nT: float) -> tuple[Array, float]:
    """Return the offset (3,) that the means of turns leave, and the squares about it."""
    means = np.array([felt.wave[0] for felt in model.felt]) - upwards_nT * model.up
    means = means[model.turned]
    there = np.isfinite(means)
    middle = np.where(there, means, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    return middle, float(np.nansum((means - middle) ** 2))


def _residuals(state: Array, model: _Model) -> Array:
    """Return all residuals in units of their standard uncertainties."""
    up, data, size_nT = model.up, model.data, model.size_nT
    count = len(up)
    azimuth = state[SENSOR : SENSOR + count, None]
    lean = (model.up_root @ state[SENSOR + count :]).reshape(count, 2, 1)
    direction = up + (lean * model.across).sum(axis=1)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    first = _cross(direction, model.apart)
    first /= np.linalg.norm(first, axis=1)[:, None]
    north = np.cos(azimuth) * first + np.sin(azimuth) * _cross(direction, first)
    west = _cross(direction, north)
    angle = (state[I] + state[AXIS] * data.tilt_rad * model.turned)[:, None]
    level, upwards = state[F] * np.cos(angle), -state[F] * np.sin(angle)
    fixed = state[PLATFORM][:, None, None] * np.stack((north, west, direction))
    mean = direction * upwards + np.where(model.turned[:, None], fixed.sum(axis=0), level * north)
    wave = np.stack((mean, level * north, -level * west), axis=1)
    read = size_nT * (wave @ state[A].reshape(3, 3).T)
    read[:, 0] += size_nT * state[O]
    apart = np.where(model.there, model.measured - read.reshape(count, 9), 0.0)
    scaled = np.einsum("fij,fj->fi", model.roots, apart)[model.there]
    prior = np.atleast_1d(_field_prior(state, data, size_nT))
    return np.concatenate((state[SENSOR + count :], state[[AXIS]], scaled, prior))


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of vectors (n, 3): `np.cross` takes ten times as long for few."""
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=1)


def _field_prior(state: Array, data: OtherAxes, size_nT: float) -> Array:
    """Return what the known field says; where none is known the gains have mean one."""
    left = []
    if data.field_nT is not None:
        size = max(data.field_u_nT, 1e-6 * data.field_nT)
        left.append((state[F] * size_nT - data.field_nT) / size)
    else:
        left.append((np.trace(state[A].reshape(3, 3)) / 3.0 - 1.0) / 1e-9)
    if data.inclination_rad is not None:
        size = max(data.inclination_u_rad, 1e-7)
        left.append((state[I] - data.inclination_rad) / size)
    return np.array(left)
