"""The results of the other six axes, with what the directions do not determine as null."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from procedures.nine_axis_calibration.dataset import AXES
from station.findings import Estimate, Flag, InputQuantity, Published, undetermined

from .coil import InCoil, coil_inputs, estimates_in_coil, solve_coil
from .inertial import CROSS, K2, PAIRS, TURN, B, Inertial, K, M, N, orientations_of, solve_inertial
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


def results_of(data: OtherAxes) -> OtherResults:
    """Return results, flags and inputs of the other six axes. Raises nothing for poor data."""
    inertial = solve_inertial(data)
    magnetic = solve_magnetic(data, inertial)
    coil = solve_coil(data.coil) if data.coil is not None else None
    estimates: list[Estimate] = []
    flags: list[Flag] = []
    if orientations_of(data):
        estimates += _of_accelerometers(data, inertial)
    if felt_of(data)[0] or data.coil is not None:
        estimates += _of_magnetometer(inertial, magnetic, coil)
    lacking = [estimate for estimate in estimates if estimate.value is None]
    if lacking:
        flags.append(_not_identifiable(lacking))
    flags += _doubts(inertial, magnetic, coil)
    return OtherResults(
        tuple(estimates),
        _misalignment(inertial) if inertial is not None and inertial.gyros else (),
        tuple(published(data)),
        tuple(flags),
        tuple(_inputs(data)),
        inertial,
        magnetic,
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
        for axis, value, size in zip(NAMES, state, u, strict=True)
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
    u = np.sqrt(np.diag(magnetic.covariance))
    for n, axis in enumerate(AXES):
        yield _estimate("magnetometer_offset", axis, magnetic.offset_nT[n], u[n])
    for n, axis in enumerate(AXES):
        place = 3 + 4 * n
        yield _estimate("magnetometer_scale_factor", axis, magnetic.gain[n, n], u[place])
    for axis, (i, j) in zip(NAMES, PAIRS, strict=True):
        slope = np.zeros(12)
        slope[3 + 3 * i + j] = 1.0 / magnetic.gain[i, i]
        slope[3 + 4 * i] = -magnetic.gain[i, j] / magnetic.gain[i, i] ** 2
        size = float(np.sqrt(slope @ magnetic.covariance @ slope))
        value = magnetic.gain[i, j] / magnetic.gain[i, i]
        yield _estimate("magnetometer_misalignment", axis, value, size, ARCSEC_PER_RAD, frame)


def _estimate(
    name: str,
    axis: str,
    value: float,
    u: float,
    factor: float = 1.0,
    extra: dict[str, str] | None = None,
    sensitivities: dict[str, float] | None = None,
) -> Estimate:
    unit = UNITS[name][1] if name in UNITS else "arcsec"
    return Estimate(
        name,
        axis,
        float(factor * value),
        unit,
        float(factor * u),
        None,
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
    if magnetic.wider > 1.0:
        message = (
            "The field differs from record to record by more than the magnetometer's noise; its "
            f"uncertainties are {magnetic.wider:.2g} times as large for it. Look for iron or "
            "currents near the bench, and for a field that goes with the table's motor."
        )
        yield Flag("field-wanders", message, None, {"ratio": magnetic.wider})


def _inputs(data: OtherAxes) -> Iterator[InputQuantity]:
    about = "local gravity"
    yield InputQuantity(GRAVITY, about, data.gravity_u_g, "g", data.source)
    if data.coil is not None:
        yield from coil_inputs(data.coil, data.source)


def published(data: OtherAxes) -> Iterator[Published]:
    """Yield the textbook's values: six positions, and half of largest and smallest."""
    means = {
        tuple(np.round(orientation.up, 6)): orientation.force_g
        for orientation in orientations_of(data)
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


def _field_samples(data: OtherAxes) -> Array:
    records = [r.field_nT for mounting in data.with_field for r in mounting.records]
    records += [rest.field_nT for rest in data.rests]
    there = [field_nT for field_nT in records if field_nT is not None]
    return np.vstack(there) if there else np.zeros((0, 3))
