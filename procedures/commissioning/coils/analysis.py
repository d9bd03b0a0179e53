"""The figures of the coils from the recorded fields: a pure function of a dataset."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate

from .causes import Measured, across_of, causes_of
from .parameters import COILS

Array = NDArray[np.float64]
GAIN, ZERO, ANGLE = "field_gain", "field_zero_mT", "probe_angle_rad"


@dataclass(frozen=True)
class Mean:
    """The mean field in mT (3,), its type A standard uncertainty (3,), the readings' noise (3,)."""

    field_mT: Array
    u_mT: Array
    noise_mT: Array
    readings: int


@dataclass(frozen=True)
class CoilFields:
    """A coil's fields on the probe's axes, and its supply's current: read back and commanded."""

    plus: Mean
    minus: Mean
    off: Mean
    read_A: float
    commanded_A: float


@dataclass(frozen=True)
class CoilDataset:
    """All of C1 and C2. `constants_mT_per_A` (3,) is what the bench file states of the coils.

    `gain_u` is the gaussmeter's relative, `zero_u_mT` its absolute standard uncertainty,
    `angle_u_rad` that of the direction of a probe that is turned by hand.
    `expected_mT` (3,) is the ambient field from a map, with `expected_u_mT`; None without one.
    """

    ambient: Mean
    coils: tuple[CoilFields, ...]
    constants_mT_per_A: Array
    gain_u: float
    zero_u_mT: float
    angle_u_rad: float = 0.0
    expected_mT: Array | None = None
    expected_u_mT: float = math.inf


@dataclass(frozen=True)
class CoilAnalysis(Analysis):
    """The outcome; `response` (3, 3) is field by probe axis over the stated field, by coil.

    `response_u` (3, 3) is its type A standard uncertainty with that of the current.
    """

    response: Array
    response_u: Array


def mean_of(field_mT: Array) -> Mean:
    """Return the mean of readings, shape (n, 3), n of at least 2.

    Raises ValueError for fewer, or for readings that are no numbers.
    """
    readings = len(field_mT)
    if readings < 2 or not np.isfinite(field_mT).all():
        raise ValueError("a mean of the field needs two readings that are numbers")
    noise_mT = np.std(field_mT, axis=0, ddof=1)
    return Mean(field_mT.mean(axis=0), noise_mT / math.sqrt(readings), noise_mT, readings)


def analyse(data: CoilDataset) -> CoilAnalysis:
    """Return coil constants, cross-axis parts, ambient field, and the causes of what is wrong.

    The difference of both senses is free of the ambient field and of the probe's zero.
    """
    columns, uncertainties = [], []
    for coil, constant in zip(data.coils, data.constants_mT_per_A, strict=True):
        stated_mT = constant * coil.read_A
        column = (coil.plus.field_mT - coil.minus.field_mT) / 2.0 / stated_mT
        type_a = np.hypot(coil.plus.u_mT, coil.minus.u_mT) / 2.0 / abs(stated_mT)
        # Which of read-back and set-point is right is not known: a rectangle between both.
        current_u = abs(coil.read_A / coil.commanded_A - 1.0) / math.sqrt(3.0)
        columns.append(column)
        uncertainties.append(np.hypot(type_a, current_u * np.abs(column)))
    response, response_u = np.column_stack(columns), np.column_stack(uncertainties)
    estimates: list[Estimate] = []
    for k, axis in enumerate(COILS):
        estimates += _of_coil(axis, k, data, response, response_u)
    estimates += [_ambient(axis, k, data.ambient) for k, axis in enumerate(COILS)]
    estimates += [_noise(axis, k, data.ambient) for k, axis in enumerate(COILS)]
    after_off = np.array([coil.off.field_mT - data.ambient.field_mT for coil in data.coils])
    after_off_u = np.array([np.hypot(coil.off.u_mT, data.ambient.u_mT) for coil in data.coils])
    measured = Measured(
        response,
        np.hypot(response_u, data.gain_u * np.abs(response)),
        data.constants_mT_per_A,
        after_off,
        after_off_u,
        data.ambient.field_mT,
        data.expected_mT,
        math.hypot(data.expected_u_mT, data.zero_u_mT),
    )
    return CoilAnalysis(estimates, (), causes_of(measured), response, response_u)


def _of_coil(
    axis: str, k: int, data: CoilDataset, response: Array, response_u: Array
) -> list[Estimate]:
    own, own_u = float(response[k, k]), float(response_u[k, k])
    across, across_u = across_of(response, response_u, k)
    along = math.sqrt(1.0 - across**2)
    coil = data.coils[k]
    freedom = float(coil.plus.readings + coil.minus.readings - 2)
    left_mT = float(coil.off.field_mT[k] - data.ambient.field_mT[k])
    left_u_mT = float(np.hypot(coil.off.u_mT[k], data.ambient.u_mT[k]))
    left_freedom = float(coil.off.readings + data.ambient.readings - 2)
    constant = float(data.constants_mT_per_A[k]) * own
    extra = {"coil_constant_mT_per_A": constant, "column": response[:, k].tolist()}
    method = "half the difference of both senses over the stated field"
    return [
        Estimate("coil_constant_ratio", axis, own, "1", own_u, freedom, method, {GAIN: own}, extra),
        Estimate("cross_axis", axis, across, "1", across_u, freedom, method, {ANGLE: along}),
        Estimate(
            "field_after_off", axis, left_mT, "mT", left_u_mT, left_freedom, "off less ambient"
        ),
    ]


def _ambient(axis: str, k: int, ambient: Mean) -> Estimate:
    field_mT, u_mT = float(ambient.field_mT[k]), float(ambient.u_mT[k])
    freedom, by = float(ambient.readings - 1), {GAIN: field_mT, ZERO: 1.0}
    return Estimate("ambient_field", axis, field_mT, "mT", u_mT, freedom, "mean", by)


def _noise(axis: str, k: int, ambient: Mean) -> Estimate:
    noise_mT, freedom = float(ambient.noise_mT[k]), float(ambient.readings - 1)
    u_mT = noise_mT / math.sqrt(2.0 * freedom)
    return Estimate("ambient_noise", axis, noise_mT, "mT", u_mT, freedom, "standard deviation")
