"""Sensitivities of all driven axes from field and gyro phasors of all lines, solved together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from .dataset import AXES, Array, Complex, Mask
from .fitted import FittedRecord

# Least part of an axis's field, orthogonal to that of the other axes, that still tells them apart.
_MIN_INDEPENDENT = 0.05
# Correct S for 2 S2 B0 when that costs less than this part of u(S), or when S2 is this many u.
_CHEAP = 0.5
_SEEN = 1e-4
_EVIDENT = 3.0
_STEP_S = 1e-4


@dataclass(frozen=True)
class LineResidual:
    """What one line leaves unexplained, as slope (along the field) and quadrature (across it)."""

    slope: float
    slope_uncertainty: float
    quadrature: float
    quadrature_uncertainty: float | None


@dataclass(frozen=True)
class AxisResponse:
    """The sensitivity of an axis, and its second-order term (deg/h/mT^2), None without a double.

    `time_slope` is d S / d (error of the field's time stamps), per s; `undriven` by axis not driven
    d S / d (sensitivity of that axis), by the field measured on it.
    """

    sensitivity: float
    uncertainty: float
    degrees_of_freedom: float
    quadratic: float | None
    quadratic_uncertainty: float | None
    quadratic_corrected: bool
    time_slope: float
    undriven: Mapping[str, float]


@dataclass(frozen=True)
class Response:
    """What usable lines say of the axes that they tell apart, with the covariance of these (k, k).

    `entangled` are those that they do not. `residuals` are by record, line and axis.
    """

    axes: Mapping[str, AxisResponse]
    covariance: Array
    entangled: tuple[str, ...] = ()
    residuals: Mapping[tuple[int, int, str], LineResidual] = field(default_factory=dict)


@dataclass(frozen=True)
class _System:
    """All usable phasors as real rows (real, imaginary): data, covariance, columns.

    `rows` are the first rows of the driven lines, by record and line.
    """

    data: Array
    covariance: Array
    freedom: Array
    linear: Array
    quadratic: Array
    ambient: Array
    undriven: Array
    field_variance: Array
    rows: dict[tuple[int, int], int]


def solve(records: Sequence[FittedRecord], doubts: Mapping[str, float]) -> Response:
    """Solve X_line = sum_a (S_a + 2 S2_a B0_a) B_a,line and X_2line = sum_a S2_a B_a,line^2 / 2.

    Weighted least squares on real and imaginary parts, with the measured field of all three
    components: the misalignment between coils and gyro axes drops out. What the field on an axis
    that is driven nowhere does is not distinguished from the drive: S is that of the driven axes
    with the share `undriven` of the other's sensitivity in it. `doubts` are the parts of results
    that are in doubt, as standard uncertainties.

    The ambient field B0 makes 2 S2 B0 of the second-order term look like first-order sensitivity.
    Fitting both at once multiplies u(S) by sqrt(1 + c^2), c = 4 B0 / M: by 1.007 at 0.03 mT against
    1 mT, by 2.2 at 0.05 mT against 0.1 mT. Monte Carlo (500 white records a case, S2 from 0 to
    0.5 deg/h/mT^2, B0 = 0.05 mT): the joint fit has no bias and covers 95 to 96 % throughout, with
    errors of 1.00, 1.05, 1.16, 2.15 bounds at 1, 0.5, 0.3, 0.1 mT; never correcting has up to 8
    bounds of bias at 1 mT, but only 0.99 to 1.26 bounds of error at 0.1 mT. So: both at once while
    c is below a half or where S2 is evident; otherwise S as it stands, and the uncertainty of
    2 S2 B0 taken into u(S), which then covers too much rather than too little.
    """
    lines = [
        line for r in records for line, used in zip(r.field.lines, r.usable, strict=True) if used
    ]
    axes = tuple(axis for axis in AXES if any(axis in line.axes for line in lines))
    if not axes:
        return Response({}, np.zeros((0, 0)))
    count, others = len(axes), [axis for axis in AXES if axis not in axes]
    system = _assemble(records, axes, 0.0)
    gain, solution, covariance = _weighted(system, np.zeros(count, dtype=bool))
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # Where an axis's double was not fitted, only noise of its field stands in its column.
    strength = np.max(np.abs(system.quadratic), axis=0)
    seen = (strength > 0.0) & (strength > _SEEN * np.max(strength))
    # d S / d S2 of what the ambient field pretends, through the same gains.
    cost = np.abs(np.diag(gain[:count] @ system.ambient)) * spread[count:]
    evident = np.abs(solution[count:]) > _EVIDENT * spread[count:]
    corrected = seen & ((cost <= _CHEAP * spread[:count]) | evident)
    gain, solution, covariance = _weighted(system, corrected)

    sensitivity, own = solution[:count], gain[:count]
    field_rows = system.field_variance @ sensitivity**2
    total = covariance[:count, :count] + (own * field_rows) @ own.T
    pretence = (own @ system.ambient)[:, seen & ~corrected] * spread[count:][seen & ~corrected]
    total += pretence @ pretence.T
    total += np.diag((np.array([doubts.get(axis, 0.0) for axis in axes]) * sensitivity) ** 2)
    late, early = (
        _weighted(_assemble(records, axes, s), corrected)[1] for s in (_STEP_S, -_STEP_S)
    )
    time_slope = (late - early) / (2.0 * _STEP_S)
    leaks, freedom = own @ system.undriven, _freedom(system, own)
    solved, second_u = {}, np.sqrt(np.diag(covariance)[count:])
    apart = [a for a in range(count) if _independent(system, a)]
    for a in apart:
        solved[axes[a]] = AxisResponse(
            sensitivity=float(sensitivity[a]),
            uncertainty=float(np.sqrt(total[a, a])),
            degrees_of_freedom=float(freedom[a]),
            quadratic=float(solution[count + a]) if seen[a] else None,
            quadratic_uncertainty=float(second_u[a]) if seen[a] else None,
            quadratic_corrected=bool(corrected[a]),
            time_slope=float(time_slope[a]),
            undriven=dict(zip(others, leaks[a].tolist(), strict=True)),
        )
    return Response(
        solved,
        total[np.ix_(apart, apart)],
        tuple(axis for axis in axes if axis not in solved),
        _residuals(records, system, corrected, gain, solution),
    )


def _assemble(records: Sequence[FittedRecord], axes: Sequence[str], shift_s: float) -> _System:
    """Return the rows of all usable lines, the field's time stamps moved by `shift_s`."""
    rows: list[tuple[complex, float, Complex, Complex, Complex, Array]] = []
    blocks: list[Array] = []
    first: dict[tuple[int, int], int] = {}
    for number, record in enumerate(records):
        gyro, slots = record.gyro, list[int]()
        for k in np.flatnonzero(record.usable).tolist():
            line = record.field.lines[k]
            turn = np.exp(-2j * np.pi * line.frequency_Hz * shift_s)
            field_mT = line.phasor_mT * turn
            pretended = 2.0 * record.field.ambient_mT * field_mT
            first[number, k] = 2 * len(rows)
            phasor, freedom = gyro.phasor_deg_per_h, gyro.degrees_of_freedom
            own = (phasor[k], freedom[k], field_mT, 0.0 * field_mT, pretended, line.variance_mT2)
            rows.append(own)
            slots.append(k)
            double = gyro.double[k]
            if double is not None:
                second, squared = line.second_mT * turn**2, 0.5 * field_mT**2
                at = phasor[double], freedom[double]
                rows.append((*at, second, squared, 0.0 * field_mT, np.zeros(3)))
                slots.append(double)
        if slots:
            used = (2 * np.array(slots)[:, None] + [0, 1]).ravel()
            blocks.append(gyro.covariance[np.ix_(used, used)])
    data, freedom, linear, quadratic, ambient, variance = map(np.array, zip(*rows, strict=True))
    picks = [AXES.index(axis) for axis in axes]
    others = [a for a in range(3) if a not in picks]
    return _System(
        data=_real(data),
        covariance=block_diag(*blocks),
        freedom=freedom,
        linear=_real(linear[:, picks]),
        quadratic=_real(quadratic[:, picks]),
        ambient=_real(ambient[:, picks]),
        undriven=_real(linear[:, others]),
        field_variance=np.repeat(variance[:, picks], 2, axis=0),
        rows=first,
    )


def _real(rows: NDArray[np.complex128]) -> Array:
    """Return complex rows (n, …) as real ones (2 n, …), in pairs."""
    return np.stack((rows.real, rows.imag), axis=1).reshape(2 * len(rows), *rows.shape[1:])


def _design(system: _System, corrected: Mask) -> Array:
    return np.hstack((system.linear, system.quadratic + system.ambient * corrected))


def _weighted(system: _System, corrected: Mask) -> tuple[Array, Array, Array]:
    """Return the gain matrix, solution and covariance of [S, S2]."""
    # A noiseless record still has an answer: keep the weights finite.
    smallest = max(float(np.trace(system.covariance)) / len(system.data) * 1e-12, 1e-30)
    root = np.linalg.cholesky(system.covariance + smallest * np.eye(len(system.data)))
    white = np.linalg.solve(root, _design(system, corrected))
    size = np.linalg.norm(white, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    inverse = np.linalg.pinv(white / size, rcond=1e-7) / size[:, None]
    gain = np.linalg.solve(root.T, inverse.T).T
    return gain, gain @ system.data, gain @ system.covariance @ gain.T


def _independent(system: _System, a: int) -> bool:
    """Whether the driven lines' field on an axis is not that on the others."""
    field_mT = system.linear[[row + part for row in system.rows.values() for part in (0, 1)]]
    own, others = field_mT[:, a], np.delete(field_mT, a, axis=1)
    alone = own - others @ np.linalg.lstsq(others, own, rcond=1e-10)[0]
    size = float(np.linalg.norm(own))
    return size > 0.0 and float(np.linalg.norm(alone)) > _MIN_INDEPENDENT * size


def _freedom(system: _System, gain: Array) -> Array:
    """Welch-Satterthwaite over the pairs of rows of each phasor."""
    pairs = gain.reshape(len(gain), -1, 2)
    count = pairs.shape[1]
    own = system.covariance.reshape(count, 2, count, 2)[range(count), :, range(count)]
    share = np.einsum("api,pij,apj->ap", pairs, own, pairs)
    below = np.sum(share**2 / system.freedom, axis=1)
    whole = share.sum(axis=1) ** 2
    return np.asarray(np.divide(whole, below, out=np.full(len(gain), np.inf), where=below > 0.0))


def _residuals(
    records: Sequence[FittedRecord], system: _System, corrected: Mask, gain: Array, solution: Array
) -> dict[tuple[int, int, str], LineResidual]:
    design = _design(system, corrected)
    left = system.data - design @ solution
    remove = np.eye(len(left)) - design @ gain
    spread = remove @ system.covariance @ remove.T
    result: dict[tuple[int, int, str], LineResidual] = {}
    for (number, k), row in system.rows.items():
        line, rows = records[number].field.lines[k], slice(row, row + 2)
        raw = system.covariance[rows, rows]
        for axis in line.axes:
            field_mT = complex(line.phasor_mT[AXES.index(axis)])
            along = np.array([field_mT.real, field_mT.imag]) / abs(field_mT) ** 2
            across = np.array([-along[1], along[0]])
            variance = float(across @ spread[rows, rows] @ across)
            # Where other unknowns use up this line nothing is left to test.
            testable = variance > 1e-6 * float(across @ raw @ across)
            result[number, k, axis] = LineResidual(
                slope=float(along @ left[rows]),
                slope_uncertainty=float(np.sqrt(along @ raw @ along)),
                quadrature=float(across @ left[rows]),
                quadrature_uncertainty=float(np.sqrt(variance)) if testable else None,
            )
    return result
