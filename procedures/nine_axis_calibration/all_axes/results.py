"""The results of the other six axes, with what the directions do not determine as null."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from procedures.common.constants import ARCSEC_PER_RAD
from procedures.common.homogeneity import entry
from procedures.nine_axis_calibration.dataset import AXES
from station.findings import Estimate, Flag, InputQuantity, Key, Published, undetermined

from .channels import screened
from .checks import doubts, implausible, not_determined, other_hemisphere
from .coil import ALIGNMENT, GAIN, ZERO, InCoil, coil_inputs, solve_coil
from .inertial import (
    CROSS,
    EDGE,
    K2,
    NOISE,
    SECOND_ORDER,
    SENSOR,
    TURN,
    B,
    Inertial,
    K,
    M,
    N,
    Orientation,
    orientations_of,
    sensitivities,
    shape_of,
    solve_inertial,
)
from .magnetic import DIRECTIONS, INCLINATION, MAGNITUDE, Felt, Magnetic, felt_of, solve_magnetic
from .stands import FIELD, FORCE, Array, OtherAxes
from .two_ways import Compared, compare, disagreements, not_as_commanded

METHOD = "least-squares"
ACCELEROMETERS, MOUNTING = {"frame": "accelerometers"}, {"frame": "mounting"}
COIL = {"frame": "coil"}
PAIRS = tuple(a + b for a, b in permutations(AXES, 2))
EDGES = tuple(AXES[i] + AXES[j] for i, j in CROSS)
EVERY = tuple(a + b for a, b in product(AXES, AXES))
GRAVITY = "prior_local_gravity"
OFFSET, SCALE, LEAN = (
    "magnetometer_offset",
    "magnetometer_scale_factor",
    "magnetometer_misalignment",
)
PER_G = "g_sensitivity"
ELLIPSOID_TERMS = 9


class Quantity(NamedTuple):
    """A result of the accelerometers' fit: its unknowns, the factor to its unit, its frame."""

    name: str
    axes: Sequence[str]
    unit: str
    unknowns: slice
    factor: float = 1.0
    extra: Mapping[str, str] = {}


OF_ACCELEROMETERS = (
    Quantity("accelerometer_bias", AXES, "g", B, 1.0, ACCELEROMETERS),
    Quantity("accelerometer_scale_factor", AXES, "1", K, 1.0, ACCELEROMETERS),
    Quantity("accelerometer_nonorthogonality", EDGES, "arcsec", N, 2.0 * ARCSEC_PER_RAD),
    Quantity("accelerometer_second_order", AXES, "ug/g^2", K2, 1e6),
    Quantity("boresight", AXES, "arcsec", TURN, ARCSEC_PER_RAD),
)
OF_GYROS = Quantity(
    "misalignment", PAIRS, "arcsec", slice(M, SENSOR), ARCSEC_PER_RAD, ACCELEROMETERS
)
SECOND_ORDER_SEEN = 50.0
"""In ug/g^2: a second order that nobody states counts where so large a one moves a result by u."""
BY_FORCE = (PER_G, EVERY, "deg/h/g")
OF_MAGNETOMETER = ((OFFSET, AXES, "nT"), (SCALE, AXES, "1"), (LEAN, PAIRS, "arcsec"))
Shared = tuple[Estimate, Mapping[str, float]]
"""A result, and what noise and each prior add to its uncertainty; nothing where that is not known.
"""


@dataclass(frozen=True)
class OtherResults:
    """What the other six axes come to; `misalignment` replaces that of the gyros, if not empty.

    `shares` is what noise and each prior add to the uncertainty of a result; `compared` what the
    coil says of what the turns determine. `orientations` and `felt` are what accelerometers and
    magnetometer felt of each direction.
    """

    estimates: tuple[Estimate, ...]
    misalignment: tuple[Estimate, ...]
    published: tuple[Published, ...]
    flags: tuple[Flag, ...]
    inputs: tuple[InputQuantity, ...]
    inertial: Inertial | None
    magnetic: Magnetic | None
    recorded: OtherAxes
    shares: Mapping[Key, Mapping[str, float]]
    compared: tuple[Compared, ...]
    orientations: tuple[Orientation, ...]
    felt: tuple[Felt, ...]


def results_of(recorded: OtherAxes) -> OtherResults:
    """Return results, flags and inputs of the other six axes. Raises nothing for poor data."""
    data, left_out = screened(recorded)
    orientations, force_steps = orientations_of(data)
    felt, delay_s, field_steps = felt_of(data)
    inertial = solve_inertial(orientations, data)
    magnetic = solve_magnetic(felt, delay_s, data, inertial)
    coil = solve_coil(data.coil) if data.coil is not None else None
    every: list[Shared] = []
    if _recorded(recorded, FORCE):
        every += _of_accelerometers(data, inertial)
    if _recorded(recorded, FIELD) or data.coil is not None:
        every += _of_magnetometer(inertial, magnetic, coil)
    compared = _two_ways(data, inertial, magnetic, coil)
    beside = {(c.of_turns.name, c.of_turns.axis): {"in_coil": c.to_data()} for c in compared}
    estimates = [
        replace(e, extra={**e.extra, **beside.get((e.name, e.axis), {})}) for e, _ in every
    ]
    gyros = [*_of_state(inertial, OF_GYROS)] if inertial is not None and inertial.gyros else []
    flags = [
        *not_determined(estimates),
        *left_out,
        *force_steps.flags(FORCE),
        *field_steps.flags(FIELD),
        *doubts(inertial, magnetic, in_coil=coil is not None),
        *implausible(estimates),
        *other_hemisphere(data, magnetic),
        *disagreements(compared),
        *(not_as_commanded(data.coil) if data.coil is not None else ()),
    ]
    return OtherResults(
        tuple(estimates),
        tuple(estimate for estimate, _ in gyros),
        tuple(published(data, orientations)),
        tuple(flags),
        tuple(_inputs(data)),
        inertial,
        magnetic,
        recorded,
        {(known.name, known.axis): shares for known, shares in (*every, *gyros) if shares},
        tuple(compared),
        orientations,
        tuple(felt),
    )


def _two_ways(
    data: OtherAxes, inertial: Inertial | None, magnetic: Magnetic | None, coil: InCoil | None
) -> list[Compared]:
    """Return what both the turns and the coil determine of the magnetometer.

    Scale factors by convention are nothing to compare with.
    """
    if magnetic is None or coil is None or data.coil is None:
        return []
    by_turns = [
        known
        for known, _ in _in_earths_field(inertial, magnetic)
        if not (magnetic.relative and known.name == SCALE)
    ]
    in_coil = [known for known, _ in _of_coil(coil)]
    return compare(by_turns, in_coil, list(coil_inputs(data.coil, data.source)))


def _recorded(data: OtherAxes, what: str) -> bool:
    return any(np.isfinite(samples).any() for _, _, samples in data.records(what))


def _unknown(name: str, axes: Sequence[str], unit: str) -> Iterator[Shared]:
    """Yield that nothing determines a result of these axes."""
    for axis in axes:
        yield undetermined(name, axis, unit, METHOD), {}


def _of_accelerometers(data: OtherAxes, inertial: Inertial | None) -> Iterator[Shared]:
    """Yield what the accelerometers are, in their own frame, and what the gyros feel of force."""
    for quantity in OF_ACCELEROMETERS:
        if inertial is None or (quantity.unknowns == K2 and not inertial.second_order):
            yield from _unknown(*quantity[:3])
        else:
            yield from _of_state(inertial, quantity)
    solved = sensitivities(data, inertial) if inertial is not None else None
    if solved is None:
        yield from _unknown(*BY_FORCE)
        return
    name, axes, unit = BY_FORCE
    for axis, value, u in zip(axes, *map(np.ravel, solved), strict=True):
        if np.isfinite(value):
            yield Estimate(name, axis, float(value), unit, float(u), None, METHOD), {}
        else:
            yield from _unknown(name, (axis,), unit)


def _of_state(inertial: Inertial, quantity: Quantity) -> Iterator[Shared]:
    """Yield a result of each axis; null of a gyro that did not answer the turns about all three."""
    name, axes, unit, unknowns, factor, extra = quantity
    values = factor * inertial.state[unknowns]
    u = factor * np.sqrt(np.diag(inertial.covariance)[unknowns])
    slopes = factor * np.eye(len(inertial.state))[unknowns]
    for axis, value, size, slope in zip(axes, values, u, slopes, strict=True):
        if quantity is OF_GYROS and not inertial.turned[AXES.index(axis[0])]:
            yield from _unknown(name, (axis,), unit)
            continue
        by = {GRAVITY: float(value / inertial.stands.gravity_g)} if unknowns == K else {}
        unstated = 1e-6 * float(np.linalg.norm(slope @ inertial.by_second_order))
        if unstated * SECOND_ORDER_SEEN > size:
            by[SECOND_ORDER] = unstated
        estimate = Estimate(
            name, axis, float(value), unit, float(size), None, METHOD, by, dict(extra)
        )
        yield estimate, inertial.shares.of(slope)


def _of_magnetometer(
    inertial: Inertial | None, magnetic: Magnetic | None, coil: InCoil | None
) -> Iterator[Shared]:
    """Yield offset, scale factor and directions of the magnetometer: diag(K)(I + M).

    Of turns and stands in the earth's field where they determine them; the coil gives the rest:
    scale factors where no field is known, all where nothing was turned.
    """
    in_coil = [] if coil is None else list(_of_coil(coil))
    if magnetic is not None:
        for of_field in _in_earths_field(inertial, magnetic):
            if not (in_coil and magnetic.relative and of_field[0].name == SCALE):
                yield of_field
            else:
                axis = of_field[0].axis
                yield next(c for c in in_coil if (c[0].name, c[0].axis) == (SCALE, axis))
    elif in_coil:
        yield from in_coil
    else:
        for quantity in OF_MAGNETOMETER:
            yield from _unknown(*quantity)


def _in_earths_field(inertial: Inertial | None, magnetic: Magnetic) -> Iterator[Shared]:
    """Yield what turns and stands at rest in the earth's field determine."""
    frame = MOUNTING if inertial is None else ACCELEROMETERS
    freedom = magnetic.freedom if math.isfinite(magnetic.freedom) else None
    for name, axis, unit, value, slope in _of_matrix(magnetic.offset_nT, magnetic.gain):
        if not magnetic.determines(slope):
            yield from _unknown(name, (axis,), unit)
            continue
        u = float(np.sqrt(slope @ magnetic.covariance @ slope))
        extra = frame if name == LEAN else {}
        estimate = Estimate(name, axis, value, unit, u, freedom, METHOD, {}, extra)
        yield estimate, magnetic.shares.of(slope)


def _of_coil(coil: InCoil) -> Iterator[Shared]:
    """Yield what the coil determines, as the gaussmeter lies."""
    for name, axis, unit, value, slope in _of_matrix(coil.offset_nT, coil.gain):
        row = AXES.index(axis[0])
        by = {
            OFFSET: {ZERO: float(np.linalg.norm(coil.gain[row]))},
            SCALE: {GAIN: value},
            LEAN: {ALIGNMENT: ARCSEC_PER_RAD},
        }[name]
        by |= {place: float(slope @ own) for place, own in coil.by_place.items()}
        u, freedom = float(np.sqrt(slope @ coil.covariance @ slope)), float(coil.freedom[row])
        at = entry(coil.at_device, axis.lower()) if name == SCALE else {}
        yield Estimate(name, axis, value, unit, u, freedom, METHOD, by, {**COIL, **at}), {}


def _of_matrix(offset_nT: Array, gain: Array) -> Iterator[tuple[str, str, str, float, Array]]:
    """Yield name, axis, unit and value of each result, and its derivatives (12,) by both."""
    for name, axes, unit in OF_MAGNETOMETER:
        for axis in axes:
            i, j = AXES.index(axis[0]), AXES.index(axis[-1])
            slope = np.zeros(12)
            if name == OFFSET:
                value, slope[i] = offset_nT[i], 1.0
            elif name == SCALE:
                value, slope[3 + 4 * i] = gain[i, i], 1.0
            else:
                value = ARCSEC_PER_RAD * gain[i, j] / gain[i, i]
                slope[3 + 3 * i + j] = ARCSEC_PER_RAD / gain[i, i]
                slope[3 + 4 * i] = -value / gain[i, i]
            yield name, axis, unit, float(value), slope


def with_rows(estimates: Sequence[Estimate], results: OtherResults) -> list[Estimate]:
    """Return estimates whose type A uncertainty is that of noise alone, each prior an input."""
    split = []
    for estimate in estimates:
        own = results.shares.get((estimate.name, estimate.axis))
        if own is not None and any(own.values()):
            priors = {name: size for name, size in own.items() if name != NOISE and size > 0.0}
            by = {**estimate.sensitivities, **priors}
            estimate = replace(estimate, standard_uncertainty=own[NOISE], sensitivities=by)
        split.append(estimate)
    return split


def prior_rows(data: OtherAxes) -> Iterator[InputQuantity]:
    """Yield the priors of the other six axes, each in units of its own standard uncertainty."""
    field_nT, inclination = data.field_u_nT, data.inclination_u_rad
    second_u = 1e6 * data.second_order_u
    described = {
        EDGE: "directions between axes, each stand",
        SECOND_ORDER: f"second order of the accelerometers, {second_u:.3g} ug/g^2",
        DIRECTIONS: "directions of the stands, as the accelerometers or the priors give them",
        MAGNITUDE: f"magnitude of the earth's field, {field_nT:.3g} nT",
        INCLINATION: f"inclination of the earth's field, {math.degrees(inclination):.3g} deg",
    }
    if not second_u:
        about = "second order of the accelerometers"
        yield InputQuantity.if_stated(SECOND_ORDER, about, None, "ug/g^2", data.source)
        del described[SECOND_ORDER]
    for name, about in described.items():
        yield InputQuantity(name, about, 1.0, "1", data.source)


def _inputs(data: OtherAxes) -> Iterator[InputQuantity]:
    about = "local gravity"
    u_g, value = data.gravity_u_g, data.gravity_g
    yield InputQuantity.if_stated(GRAVITY, about, u_g, "g", data.source, value=value)
    if data.coil is not None:
        yield from coil_inputs(data.coil, data.source)


def published(data: OtherAxes, orientations: Sequence[Orientation]) -> Iterator[Published]:
    """Yield the textbook's values: six positions, and half of largest and smallest."""
    means = {
        tuple(np.round(orientation.up, 6)): orientation.force_g for orientation in orientations
    }
    for n, axis in enumerate(AXES):
        up, down = (means.get(tuple(sign * np.eye(3)[n])) for sign in (1.0, -1.0))
        if up is not None and down is not None:
            bias, scale = (up[n] + down[n]) / 2.0, (up[n] - down[n]) / (2.0 * data.gravity_g)
            yield Published("accelerometer_bias", axis, float(bias), "g", "six-position")
            yield Published("accelerometer_scale_factor", axis, float(scale), "1", "six-position")
    samples = np.vstack([np.zeros((0, 3)), *(own for _, _, own in data.records(FIELD))])
    if not len(samples):
        return
    high, low = np.fmax.reduce(samples), np.fmin.reduce(samples)
    nearest = ellipsoid(samples)
    of_method = {"min-max": ((high + low) / 2.0, (high - low) / 2.0)}
    if nearest is not None:
        of_method["ellipsoid"] = nearest[0], np.diag(nearest[1])
    for method, (middle, size) in of_method.items():
        for axis, value in zip(AXES, middle, strict=True):
            if np.isfinite(value):
                yield Published(OFFSET, axis, float(value), "nT", method)
        for axis, value in zip(AXES, size, strict=True):
            if data.field_nT is not None and np.isfinite(value):
                yield Published(SCALE, axis, float(value) / data.field_nT, "1", method)


def ellipsoid(samples: Array) -> tuple[Array, Array] | None:
    """Return middle (3,) and root (3, 3) of the ellipsoid nearest to samples (n, 3).

    The root maps the unit sphere to it without a turn. By least squares of its equation, as the
    textbook has it: noise moves the middle. None where the samples lie on no ellipsoid.
    """
    samples = samples[np.isfinite(samples).all(axis=1)]
    if len(samples) < ELLIPSOID_TERMS:
        return None
    size = float(np.median(np.linalg.norm(samples - samples.mean(axis=0), axis=1))) or 1.0
    x, y, z = (samples / size).T
    columns = np.column_stack((x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z))
    normal = columns.T @ columns
    if np.linalg.matrix_rank(normal, hermitian=True) < ELLIPSOID_TERMS:
        return None
    a, b, c, d, e, f, *line = np.linalg.solve(normal, columns.sum(axis=0))
    form = np.array([[a, d, e], [d, b, f], [e, f, c]])
    if float(np.linalg.eigvalsh(form)[0]) <= 0.0:
        return None
    middle = -0.5 * np.linalg.solve(form, np.array(line))
    values, vectors = np.linalg.eigh(form / (1.0 + middle @ form @ middle))
    return size * middle, size * (vectors / np.sqrt(values)) @ vectors.T


def other_sensors(others: OtherResults) -> dict[str, object]:
    """Return what the calibration file holds of them: offsets, matrices, covariances, by sensor."""
    data: dict[str, object] = {}
    inertial, magnetic = others.inertial, others.magnetic
    if inertial is not None:
        own = [*range(9)]  # bias, scale factor and non-orthogonality stand first
        names = [
            *(f"bias {axis}" for axis in AXES),
            *(f"scale_factor {axis}" for axis in AXES),
            *(f"half_nonorthogonality {edge}" for edge in EDGES),
        ]
        gain = inertial.state[K][:, None] * shape_of(inertial.state)
        data["accelerometers"] = {
            "unit": "g",
            "frame": "accelerometers",
            "model": "output = bias + gain * force + second_order * force^2, gain = diag(scale "
            "factors) * (1 + half of the non-orthogonality, in rad)",
            "bias": inertial.state[B].tolist(),
            "gain": gain.tolist(),
            "inverse_gain": np.linalg.inv(gain).tolist(),
            "second_order": inertial.state[K2].tolist() if inertial.second_order else None,
            "covariance": {
                "names": names,
                "matrix": inertial.covariance[np.ix_(own, own)].tolist(),
            },
        }
    if magnetic is not None and magnetic.whole:
        names = [*(f"offset {axis}" for axis in AXES), *(f"gain {pair}" for pair in EVERY)]
        data["magnetometer"] = {
            "unit": "nT",
            "frame": "mounting" if inertial is None else "accelerometers",
            "model": "output = offset + gain * field",
            "relative": magnetic.relative,
            "offset": magnetic.offset_nT.tolist(),
            "gain": magnetic.gain.tolist(),
            "inverse_gain": np.linalg.inv(magnetic.gain).tolist(),
            "covariance": {"names": names, "matrix": magnetic.covariance.tolist()},
        }
    return data
