"""The magnetometer in the earth's field: offset, scale factors and directions, from its turns.

Outputs are o + A (n Z + c cos theta - (n x c) sin theta), c across n and H long, F^2 = H^2 + Z^2:
n is what points up, theta the table's angle. A stand at rest is one of them at an unknown heading.
The table's axis leans a little from the vertical, which moves H and Z of all turns alike, and of no
stand at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from .inertial import SURE, Inertial
from .stands import Array, Mounted, OtherAxes, Rest, plane_across
from .waves import Wave, at_rest, waves_of

O, A, F, I, AXIS = slice(0, 3), slice(3, 12), 12, 13, 14  # noqa: E741
SENSOR = 15
FIELD_SCALE_NT = 50_000.0
"""Unknowns of the field are in units of it, so that all are about one."""
SMALLEST = 1e-9


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

    `relative` says that no field was known: gains have mean one. `delay_s` (3,) is how late each
    axis answers. `wider` is by how much uncertainties grew since the directions disagree.
    """

    offset_nT: Array
    gain: Array
    covariance: Array
    relative: bool
    wider: float
    field_nT: float
    inclination_deg: float
    delay_s: Array


def felt_of(data: OtherAxes) -> tuple[list[Felt], Array]:
    """Return what was felt in every direction, and the delay of each axis in s (3,)."""
    mounted = [(mounting, _waves(mounting)) for mounting in data.with_field]
    delay_s = _delay([waves for _, waves in mounted])
    felt = [_averaged(mounting, waves, delay_s) for mounting, waves in mounted if waves]
    felt += [_of_rest(rest, rest.field_nT) for rest in data.rests if rest.field_nT is not None]
    whole = [direction for direction in felt if np.isfinite(direction.wave[0]).all()]
    return whole, delay_s


def _waves(mounting: Mounted) -> list[Wave]:
    samples = [record.field_nT for record in mounting.records if record.field_nT is not None]
    return [wave for wave in waves_of(mounting, samples) if np.isfinite(wave.value).all()]


def _of_rest(rest: Rest, field_nT: Array) -> Felt:
    mean, u = at_rest(rest, field_nT)
    wave = np.full((3, 3), np.nan)
    wave[0] = mean
    return Felt(rest.name, wave, np.diag(np.tile(u**2, 3)), rest.up, turned=False)


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
            share = size**2 * np.abs(ahead)
            delay += share * np.angle(ahead) / (2.0 * size)
            weight += share
    return np.asarray(delay / weight)


def _averaged(mounting: Mounted, waves: Sequence[Wave], delay_s: Array) -> Felt:
    """Return the wave of a mounting, both senses alike: what goes with the rate drops out."""
    senses = []
    for sign in (1.0, -1.0):
        own = [wave for wave in waves if np.sign(wave.rate_rad_per_s) == sign]
        if own:
            senses.append(_weighted(own, delay_s))
    value = np.mean([wave for wave, _ in senses], axis=0)
    covariance = np.sum([share for _, share in senses], axis=0) / len(senses) ** 2
    return Felt(mounting.name, value, covariance, mounting.up, turned=True)


def _weighted(waves: Sequence[Wave], delay_s: Array) -> tuple[Array, Array]:
    weights = np.array([1.0 / max(float(wave.inverse[0, 0]), SMALLEST) for wave in waves])
    weights /= weights.sum()
    value, covariance = np.zeros((3, 3)), np.zeros((9, 9))
    for weight, wave in zip(weights, waves, strict=True):
        turned = (wave.value[1] + 1j * wave.value[2]) * np.exp(-1j * delay_s * wave.rate_rad_per_s)
        value += weight * np.array([wave.value[0], turned.real, turned.imag])
        covariance += weight**2 * np.kron(wave.inverse, np.diag(wave.sigma**2))
    return value, covariance


def solve_magnetic(data: OtherAxes, inertial: Inertial | None) -> Magnetic | None:
    """Return the magnetometer's offset and matrix; None where the directions determine neither."""
    felt, delay_s = felt_of(data)
    turned = [direction for direction in felt if direction.turned]
    if not turned:
        return None
    up, up_root = _known_up(felt, data, inertial)
    known = data.field_nT is not None
    size_nT = data.field_nT or FIELD_SCALE_NT
    state = _start(felt, up, data, size_nT)
    roots = [_root(direction) for direction in felt]

    def residuals(at: Array) -> Array:
        return _residuals(at, felt, roots, up, up_root, data, size_nT)

    fit = least_squares(residuals, state, method="lm", xtol=1e-13, ftol=1e-13, gtol=1e-13)
    normal = fit.jac.T @ fit.jac
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    eigen = np.linalg.eigvalsh(normal / np.outer(scale, scale))
    if eigen[0] < 1e-11:
        return None
    freedom = len(fit.fun) - len(state)
    square = 2.0 * float(fit.cost)
    wider = 1.0
    if freedom > 0 and chdtrc(freedom, square) < SURE:
        wider = float(np.sqrt(square / freedom))
    covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale) * wider**2
    units = np.concatenate((np.full(3, size_nT), np.ones(9)))
    offset, gain = fit.x[O] * size_nT, fit.x[A].reshape(3, 3)
    return Magnetic(
        offset,
        gain,
        covariance[:12, :12] * np.outer(units, units),
        not known,
        wider,
        float(fit.x[F] * size_nT),
        float(np.degrees(fit.x[I])),
        delay_s,
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


def _root(felt: Felt) -> Array:
    count = 9 if felt.turned else 3
    return np.asarray(np.linalg.inv(np.linalg.cholesky(felt.covariance[:count, :count])))


def _start(felt: Sequence[Felt], up: Array, data: OtherAxes, size_nT: float) -> Array:
    """Return where the search begins: an ideal sensor, the offset that the means leave."""
    state = np.zeros(SENSOR + len(felt) + 2 * len(felt))
    state[A] = np.eye(3).ravel()
    turned = [n for n, direction in enumerate(felt) if direction.turned]
    across_nT = float(np.mean([np.linalg.norm(felt[n].wave[1:]) / np.sqrt(2.0) for n in turned]))
    field_nT = data.field_nT or FIELD_SCALE_NT
    angle = data.inclination_rad
    if angle is None:
        angle = float(np.arccos(min(across_nT / field_nT, 0.999)))
        angle *= _sense(felt, up, turned, field_nT * np.sin(angle))
    state[F], state[I] = field_nT / size_nT, angle
    upwards = -field_nT * float(np.sin(angle))
    offset = np.mean([felt[n].wave[0] - upwards * up[n] for n in turned], axis=0)
    state[O] = offset / size_nT
    for n, direction in enumerate(felt):
        plane = plane_across(up[n])
        seen = (
            direction.wave[1] if direction.turned else direction.wave[0] - offset - upwards * up[n]
        )
        state[SENSOR + n] = np.arctan2(plane[1] @ seen, plane[0] @ seen)
    return state


def _sense(felt: Sequence[Felt], up: Array, turned: Sequence[int], down_nT: float) -> float:
    """Return the sign of the inclination for which the means leave the least apart."""
    left = {}
    for sign in (1.0, -1.0):
        offsets = np.array([felt[n].wave[0] + sign * down_nT * up[n] for n in turned])
        left[sign] = float(np.sum((offsets - offsets.mean(axis=0)) ** 2))
    return min(left, key=lambda sign: left[sign])


def _residuals(
    state: Array,
    felt: Sequence[Felt],
    roots: Sequence[Array],
    up: Array,
    up_root: Array,
    data: OtherAxes,
    size_nT: float,
) -> Array:
    """Return all residuals in units of their standard uncertainties."""
    count = len(felt)
    gain = state[A].reshape(3, 3)
    azimuth = state[SENSOR : SENSOR + count]
    lean = (up_root @ state[SENSOR + count :]).reshape(count, 2)
    parts = [state[SENSOR + count :], state[[AXIS]]]
    for n, sensed in enumerate(felt):
        angle = state[I] + (state[AXIS] * data.tilt_rad if sensed.turned else 0.0)
        level, upwards = state[F] * np.cos(angle), -state[F] * np.sin(angle)
        direction = up[n] + lean[n] @ plane_across(up[n])
        direction = direction / np.linalg.norm(direction)
        first, second = plane_across(direction, up[n])
        toward = level * (np.cos(azimuth[n]) * first + np.sin(azimuth[n]) * second)
        wave = np.array([direction * upwards, toward, -np.cross(direction, toward)])
        if not sensed.turned:
            wave = wave[:1] + wave[1:2]
        read = size_nT * (wave @ gain.T)
        read[0] += size_nT * state[O]
        measured = sensed.wave if sensed.turned else sensed.wave[:1]
        parts.append(roots[n] @ (measured - read).ravel())
    parts.append(np.atleast_1d(_field_prior(state, data, size_nT)))
    return np.concatenate(parts)


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
