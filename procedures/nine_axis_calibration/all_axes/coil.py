"""The magnetometer in a three-axis coil, with the gaussmeter as the reference.

Outputs are o + A b, b as the gaussmeter reads it along the sensor's axes. What the gaussmeter's
gain, its zero and its direction are off is whole in the results, and no record shows it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procedures.nine_axis_calibration.dataset import AXES
from procedures.nine_axis_calibration.means import QUANTUM_PART, good_samples, smallest_step
from station.findings import Estimate, InputQuantity

from .stands import Array, CoilRecord

GAIN, ZERO, ALIGNMENT = "prior_gaussmeter_gain", "prior_gaussmeter_zero", "prior_coil_alignment"
FRAME = {"frame": "coil"}
METHOD = "least-squares"
ARCSEC_PER_RAD = float(np.degrees(1.0)) * 3600.0
THRESHOLD = 5.0
UNKNOWNS = 4
SMALLEST_SPREAD = 1e-3


@dataclass(frozen=True)
class InCoil:
    """Offset and matrix, a row an axis: `state` (3, 4), `covariance` (3, 4, 4), `freedom` (3,)."""

    state: Array
    covariance: Array
    freedom: Array


def solve_coil(record: CoilRecord) -> InCoil | None:
    """Return offset and matrix; None where the fields do not span three directions."""
    state, covariance = np.zeros((3, UNKNOWNS)), np.zeros((3, UNKNOWNS, UNKNOWNS))
    freedom = np.zeros(3)
    for axis in range(3):
        output = record.output_nT[:, axis]
        step = smallest_step([output])
        good = np.isfinite(output) & np.isfinite(record.applied_nT).all(axis=1)
        for _ in range(2):
            applied = record.applied_nT[good]
            if len(applied) <= UNKNOWNS or not _spans(applied):
                return None
            design = np.column_stack((np.ones(len(applied)), applied))
            inverse = np.linalg.inv(design.T @ design)
            solved = inverse @ (design.T @ output[good])
            left = output - solved[0] - record.applied_nT @ solved[1:]
            freedom[axis] = len(applied) - UNKNOWNS
            variance = max(float(np.sum(left[good] ** 2)) / freedom[axis], step**2 / 12.0)
            state[axis], covariance[axis] = solved, variance * inverse
            good &= good_samples(left, THRESHOLD, QUANTUM_PART * step)
    return InCoil(state, covariance, freedom)


def _spans(applied: Array) -> bool:
    spread = np.linalg.svd(applied - applied.mean(axis=0), compute_uv=False)
    return bool(spread[-1] > SMALLEST_SPREAD * spread[0])


def estimates_in_coil(in_coil: InCoil) -> Iterator[Estimate]:
    """Yield offset, scale factor and directions, as the gaussmeter lies."""
    gain = in_coil.state[:, 1:]
    for n, axis in enumerate(AXES):
        u = float(np.sqrt(in_coil.covariance[n, 0, 0]))
        by_zero = {ZERO: float(np.linalg.norm(gain[n]))}
        yield _estimate(
            "magnetometer_offset", axis, in_coil.state[n, 0], "nT", u, in_coil, n, by_zero
        )
    for n, axis in enumerate(AXES):
        u = float(np.sqrt(in_coil.covariance[n, n + 1, n + 1]))
        by_gain = {GAIN: float(gain[n, n])}
        yield _estimate("magnetometer_scale_factor", axis, gain[n, n], "1", u, in_coil, n, by_gain)
    for n, axis in enumerate(AXES):
        for m, other in enumerate(AXES):
            if n == m:
                continue
            slope = np.zeros(UNKNOWNS)
            slope[m + 1], slope[n + 1] = 1.0 / gain[n, n], -gain[n, m] / gain[n, n] ** 2
            u = ARCSEC_PER_RAD * float(np.sqrt(slope @ in_coil.covariance[n] @ slope))
            value = ARCSEC_PER_RAD * gain[n, m] / gain[n, n]
            lean = {ALIGNMENT: ARCSEC_PER_RAD}
            name = "magnetometer_misalignment"
            yield _estimate(name, axis + other, value, "arcsec", u, in_coil, n, lean, FRAME)


def _estimate(
    name: str,
    axis: str,
    value: float,
    unit: str,
    u: float,
    in_coil: InCoil,
    row: int,
    sensitivities: dict[str, float],
    extra: dict[str, str] | None = None,
) -> Estimate:
    freedom = float(in_coil.freedom[row])
    return Estimate(name, axis, float(value), unit, u, freedom, METHOD, sensitivities, extra or {})


def coil_inputs(record: CoilRecord, source: str) -> Iterator[InputQuantity]:
    """Yield what the reference may be off."""
    yield InputQuantity(GAIN, "gain of the gaussmeter", record.gain_u, "1", source)
    yield InputQuantity(ZERO, "zero of the gaussmeter", record.zero_u_nT, "nT", source)
    about = "direction of the gaussmeter's axes to the sensor's"
    yield InputQuantity(ALIGNMENT, about, record.alignment_u_rad, "rad", source)
