"""The results of the other six axes, with what the directions do not determine as null."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from procedures.nine_axis_calibration.dataset import AXES
from station.findings import Estimate, Flag, InputQuantity, Published, undetermined

from .channels import (
    ACCELEROMETER,
    MAGNETOMETER,
    clipped_flags,
    coarse_flags,
    without_clipped,
    without_stuck,
)
from .coil import InCoil, coil_inputs, estimates_in_coil, solve_coil
from .inertial import (
    CROSS,
    K2,
    PAIRS,
    TURN,
    B,
    Inertial,
    K,
    M,
    N,
    Orientation,
    orientations_of,
    solve_inertial,
)
from .magnetic import Magnetic, felt_of, solve_magnetic
from .sensitivity import UNIT as PER_G
from .sensitivity import g_sensitivity
from .stands import Array, OtherAxes

METHOD = "least-squares"
ARCSEC_PER_RAD = float(np.degrees(1.0)) * 3600.0
ACCELEROMETERS = {"frame": "accelerometers"}
MOUNTING = {"frame": "mounting"}
NAMES = tuple(AXES[i] + AXES[j] for i, j in permutations(range(3), 2))
EDGES = tuple(AXES[i] + AXES[j] for i, j in CROSS)
EVERY = tuple(a + b for a in AXES for b in AXES)
UNITS = {
    "accelerometer_bias": (AXES, "g"),
    "accelerometer_scale_factor": (AXES, "1"),
    "accelerometer_nonorthogonality": (EDGES, "arcsec"),
    "accelerometer_second_order": (AXES, "ug/g^2"),
    "boresight": (AXES, "arcsec"),
    "g_sensitivity": (EVERY, PER_G),
    "magnetometer_offset": (AXES, "nT"),
    "magnetometer_scale_factor": (AXES, "1"),
    "magnetometer_misalignment": (NAMES, "arcsec"),
}
GRAVITY, FIELD = "prior_local_gravity", "prior_earth_field"
SCALE = "magnetometer_scale_factor"
PLATFORM_AXES = ("north", "west", "up")
"""Of a field fixed to what turns, at the encoder's zero."""
ELLIPSOID_TERMS = 9
MAX_FROM_ONE = {"accelerometer_scale_factor": 0.05, SCALE: 0.2}
"""Soft iron takes a magnetometer by 5 %; no sensor leaves its maker with more than these."""
IN_ACCELEROMETERS = [name for name in UNITS if not name.startswith("magnetometer")]
IN_MAGNETOMETER = [name for name in UNITS if name.startswith("magnetometer")]


@dataclass(frozen=True)
class OtherResults:
    """What the other six axes come to; `misalignment` replaces that of the gyros, if not empty."""

    estimates: tuple[Estimate, ...]
    misalignment: tuple[Estimate, ...]
    published: tuple[Published, ...]
    flags: tuple[Flag, ...]
    inputs: tuple[InputQuantity, ...]
    inertial: Inertial | None
    magnetic: Magnetic | None
    recorded: OtherAxes


def results_of(data: OtherAxes) -> OtherResults:
    """Return results, flags and inputs of the other six axes. Raises nothing for poor data."""
    recorded = data
    data, clipped = without_clipped(data)
    data, stuck = without_stuck(data)
    orientations, force_steps = orientations_of(data)
    felt, delay_s, field_steps = felt_of(data)
    inertial = solve_inertial(orientations, data)
    magnetic = solve_magnetic(felt, delay_s, data, inertial)
    coil = solve_coil(data.coil) if data.coil is not None else None
    estimates: list[Estimate] = []
    flags: list[Flag] = []
    if (
        clipped
        or stuck
        or any(np.isfinite(orientation.force_u).any() for orientation in orientations)
    ):
        estimates += _of_accelerometers(data, inertial)
    if felt or data.coil is not None or any(c.sensor == MAGNETOMETER for c in clipped):
        estimates += _of_magnetometer(inertial, magnetic, coil)
    lacking = [estimate for estimate in estimates if estimate.value is None]
    if lacking:
        flags.append(_not_identifiable(lacking))
    flags += clipped_flags(clipped)
    flags += stuck
    flags += coarse_flags(ACCELEROMETER, force_steps)
    flags += coarse_flags(MAGNETOMETER, field_steps)
    flags += _doubts(inertial, magnetic, coil)
    flags += _implausible(estimates)
    return OtherResults(
        tuple(estimates),
        _misalignment(inertial) if inertial is not None and inertial.gyros else (),
        tuple(published(data, orientations)),
        tuple(flags),
        tuple(_inputs(data)),
        inertial,
        magnetic,
        recorded,
    )


def _of_accelerometers(data: OtherAxes, inertial: Inertial | None) -> Iterator[Estimate]:
    """Yield what the accelerometers are, in their own frame."""
    if inertial is None:
        for name in IN_ACCELEROMETERS:
            axes, unit = UNITS[name]
            yield from (undetermined(name, axis, unit, METHOD) for axis in axes)
        return
    u = np.sqrt(np.diag(inertial.covariance))
    by_gravity = inertial.state[K] / data.gravity_g
    for n, axis in enumerate(AXES):
        yield _estimate(
            "accelerometer_bias", axis, inertial.state[B][n], u[B][n], 1.0, ACCELEROMETERS
        )
    for n, axis in enumerate(AXES):
        yield _estimate(
            "accelerometer_scale_factor",
            axis,
            inertial.state[K][n],
            u[K][n],
            1.0,
            ACCELEROMETERS,
            {GRAVITY: float(by_gravity[n])},
        )
    twice = 2.0 * ARCSEC_PER_RAD
    for n, axis in enumerate(EDGES):
        yield _estimate(
            "accelerometer_nonorthogonality", axis, inertial.state[N][n], u[N][n], twice
        )
    for n, axis in enumerate(AXES):
        name = "accelerometer_second_order"
        if inertial.second_order:
            yield _estimate(name, axis, inertial.state[K2][n], u[K2][n], 1e6)
        else:
            yield undetermined(name, axis, UNITS[name][1], METHOD)
    for n, axis in enumerate(AXES):
        yield _estimate("boresight", axis, inertial.state[TURN][n], u[TURN][n], ARCSEC_PER_RAD)
    yield from g_sensitivity(data, inertial)


def _misalignment(inertial: Inertial) -> tuple[Estimate, ...]:
    """Return the gyros' directions to the accelerometers: no mounting is in them."""
    own = slice(M, M + len(PAIRS))
    state, u = inertial.state[own], np.sqrt(np.diag(inertial.covariance))[own]
    return tuple(
        _estimate("misalignment", axis, value, size, ARCSEC_PER_RAD, ACCELEROMETERS)
        if inertial.turned[gyro]
        else undetermined("misalignment", axis, "arcsec", METHOD)
        for axis, (gyro, _), value, size in zip(NAMES, PAIRS, state, u, strict=True)
    )


def _of_magnetometer(
    inertial: Inertial | None, magnetic: Magnetic | None, coil: InCoil | None
) -> Iterator[Estimate]:
    """Yield offset, scale factor and directions of the magnetometer: diag(K)(I + M).

    Of turns and stands in the earth's field where they determine them; the coil gives the rest:
    scale factors where no field is known, all where nothing was turned.
    """
    in_coil = list(estimates_in_coil(coil)) if coil is not None else []
    if magnetic is None and in_coil:
        yield from in_coil
        return
    for estimate in _in_earths_field(inertial, magnetic):
        if in_coil and magnetic is not None and magnetic.relative and estimate.name == SCALE:
            yield next(c for c in in_coil if (c.name, c.axis) == (SCALE, estimate.axis))
        else:
            yield estimate


def _in_earths_field(inertial: Inertial | None, magnetic: Magnetic | None) -> Iterator[Estimate]:
    """Yield what turns and stands at rest in the earth's field determine."""
    frame = MOUNTING if inertial is None else ACCELEROMETERS
    if magnetic is None:
        for name in IN_MAGNETOMETER:
            axes, unit = UNITS[name]
            yield from (undetermined(name, axis, unit, METHOD) for axis in axes)
        return
    for name, axis, value, factor, slope in slopes_of(magnetic):
        u = float(np.sqrt(slope @ magnetic.covariance @ slope))
        extra = frame if name == IN_MAGNETOMETER[2] else None
        if magnetic.determines(slope):
            yield _estimate(name, axis, value, u, factor, extra, freedom=magnetic.freedom)
        else:
            yield undetermined(name, axis, UNITS[name][1], METHOD)


def slopes_of(magnetic: Magnetic) -> Iterator[tuple[str, str, float, float, Array]]:
    """Yield name and axis of each result, its value, the factor to its unit, and its derivatives
    (12,) by offset and gain."""
    gain = magnetic.gain
    for n, axis in enumerate(AXES):
        yield IN_MAGNETOMETER[0], axis, magnetic.offset_nT[n], 1.0, np.eye(12)[n]
    for n, axis in enumerate(AXES):
        yield SCALE, axis, gain[n, n], 1.0, np.eye(12)[3 + 4 * n]
    for axis, (i, j) in zip(NAMES, PAIRS, strict=True):
        slope = np.zeros(12)
        slope[3 + 3 * i + j] = 1.0 / gain[i, i]
        slope[3 + 4 * i] = -gain[i, j] / gain[i, i] ** 2
        yield IN_MAGNETOMETER[2], axis, gain[i, j] / gain[i, i], ARCSEC_PER_RAD, slope


def _estimate(
    name: str,
    axis: str,
    value: float,
    u: float,
    factor: float = 1.0,
    extra: dict[str, str] | None = None,
    sensitivities: dict[str, float] | None = None,
    freedom: float = np.inf,
) -> Estimate:
    unit = UNITS[name][1] if name in UNITS else "arcsec"
    return Estimate(
        name,
        axis,
        float(factor * value),
        unit,
        float(factor * u),
        freedom if np.isfinite(freedom) else None,
        METHOD,
        sensitivities or {},
        extra or {},
    )


def _not_identifiable(lacking: Sequence[Estimate]) -> Flag:
    names = list(dict.fromkeys(estimate.name for estimate in lacking))
    listed = ", ".join(name.replace("_", " ") for name in names)
    message = (
        f"Not determined by the directions in which the sensor stood: {listed}. Accelerometers "
        "need directions that face down, their second order more than the six faces."
    )
    return Flag("not-identifiable", message, None, {"coefficients": names})


def _doubts(
    inertial: Inertial | None, magnetic: Magnetic | None, coil: InCoil | None
) -> Iterator[Flag]:
    """Yield what the data contradict of each other."""
    if inertial is not None and inertial.wider > 1.0:
        message = (
            "The accelerometers' means disagree by more than their noise and the priors of the "
            f"set-up explain; their uncertainties are {inertial.wider:.2g} times as large for it. "
            "Look for a stand that leans, or that was moved."
        )
        yield Flag("poses-disagree", message, None, {"ratio": inertial.wider})
    if magnetic is None:
        return
    if magnetic.relative and coil is None:
        message = (
            "The earth's field is not stated: the magnetometer's scale factors have mean one by "
            "convention, and are relative to each other only. Give `earth_field`."
        )
        yield Flag("scale-by-convention", message)
    if magnetic.disturbed:
        size_nT = float(np.linalg.norm(magnetic.platform_nT))
        stands = " The stands at rest deny it and are left out." if magnetic.stands_left_out else ""
        message = (
            f"A field of {size_nT:.3g} nT is fixed to what turns, and no part of the earth's: it "
            f"is solved for, and in the uncertainties.{stands} Look for iron on the table and in "
            "the fixture, and mount the sensor on something that is not magnetic."
        )
        parts = zip(PLATFORM_AXES, magnetic.platform_nT, strict=True)
        details: dict[str, object] = {"field_nT": size_nT}
        details |= {f"{axis}_nT": float(value) for axis, value in parts}
        yield Flag("field-disturbed", message, None, details)
    if magnetic.wander_nT > 0.0:
        message = (
            f"The field differs from record to record by {magnetic.wander_nT:.2g} nT, more than "
            "the magnetometer's noise; each record counts as that uncertain. Look for iron or "
            "currents near the bench, and for a field that goes with the table's motor."
        )
        yield Flag("field-wanders", message, None, {"wander_nT": magnetic.wander_nT})


def _implausible(estimates: Sequence[Estimate]) -> Iterator[Flag]:
    """Yield a flag for each sensor whose scale factors deny the unit, sign or axis of an output."""
    for name, most in MAX_FROM_ONE.items():
        off = [
            estimate
            for estimate in estimates
            if estimate.name == name
            and estimate.value is not None
            and abs(estimate.value - 1.0) > most
        ]
        if not off:
            continue
        sensor = name.removesuffix("_scale_factor")
        values = ", ".join(f"{estimate.axis} {estimate.value:.4g}" for estimate in off)
        message = (
            f"The {sensor} answers {values} times what is there: its unit, its sign or the order "
            "of its axes is not as stated. Look at the columns and at how the sensor stood."
        )
        yield Flag("contradicts-statement", message, None, {"statement": "unit", "sensor": sensor})


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
        up = tuple(np.eye(3)[n])
        down = tuple(-np.eye(3)[n])
        if up in means and down in means:
            above, below = float(means[up][n]), float(means[down][n])
            values = {
                "accelerometer_bias": (above + below) / 2.0,
                "accelerometer_scale_factor": (above - below) / (2.0 * data.gravity_g),
            }
            for name, value in values.items():
                yield Published(name, axis, value, UNITS[name][1], "six-position")
    samples = _field_samples(data)
    if not len(samples):
        return
    high, low = np.nanmax(samples, axis=0), np.nanmin(samples, axis=0)
    for n, axis in enumerate(AXES):
        middle = float(high[n] + low[n]) / 2.0
        yield Published("magnetometer_offset", axis, middle, "nT", "min-max")
    if data.field_nT is not None:
        for n, axis in enumerate(AXES):
            scale = float(high[n] - low[n]) / (2.0 * data.field_nT)
            yield Published("magnetometer_scale_factor", axis, scale, "1", "min-max")
    fitted = ellipsoid(samples)
    if fitted is None:
        return
    for n, axis in enumerate(AXES):
        yield Published("magnetometer_offset", axis, float(fitted[0][n]), "nT", "ellipsoid")
        if data.field_nT is not None:
            scale = float(fitted[1][n, n]) / data.field_nT
            yield Published("magnetometer_scale_factor", axis, scale, "1", "ellipsoid")


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


def _field_samples(data: OtherAxes) -> Array:
    records = [r.field_nT for mounting in data.with_field for r in mounting.records]
    records += [rest.field_nT for rest in data.rests]
    there = [field_nT for field_nT in records if field_nT is not None]
    return np.vstack(there) if there else np.zeros((0, 3))
