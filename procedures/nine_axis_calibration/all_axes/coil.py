"""The magnetometer in a three-axis coil, with the gaussmeter as the reference.

Outputs are o + A b, b as the gaussmeter reads it along the sensor's axes. What the gaussmeter's
gain, its zero and its direction are off is whole in the results, and no record shows it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from procedures.common.helmholtz import FieldAtDevice
from procedures.estimation.channel import smallest_step
from procedures.nine_axis_calibration.means import QUANTUM_PART, good_samples
from station.findings import InputQuantity

from .channels import OUTLIER
from .stands import Array, CoilRecord

GAIN, ZERO, ALIGNMENT = "prior_gaussmeter_gain", "prior_gaussmeter_zero", "prior_coil_alignment"
UNKNOWNS = 4
FEWEST_TO_REJECT = 30
"""Of fewer rows four unknowns leave too little to tell a wild one by: none is left out."""
SMALLEST_SPREAD = 1e-3


@dataclass(frozen=True)
class InCoil:
    """Offset (3,) in nT, matrix `gain` (3, 3), covariance (12, 12) of both, row by row; the degrees
    of freedom of each row (3,), the noise of its outputs. `at_device` is how the field at the
    sensor follows from that at the probe, `by_place` the derivatives (12,) by its inputs."""

    offset_nT: Array
    gain: Array
    covariance: Array
    freedom: Array
    sigma_nT: Array
    at_device: FieldAtDevice | None
    by_place: Mapping[str, Array]


def solve_coil(record: CoilRecord) -> InCoil | None:
    """Return offset and matrix; None where the fields do not span three directions."""
    state, covariance, freedom = np.zeros((3, UNKNOWNS)), np.zeros((12, 12)), np.zeros(3)
    sigma_nT = np.zeros(3)
    for axis in range(3):
        output = record.output_nT[:, axis]
        step = smallest_step(output[np.isfinite(output)])
        good = np.isfinite(output) & np.isfinite(record.applied_nT).all(axis=1)
        own = [axis, *range(3 + 3 * axis, 6 + 3 * axis)]
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
            state[axis], covariance[np.ix_(own, own)] = solved, variance * inverse
            sigma_nT[axis] = np.sqrt(variance)
            if len(applied) >= FEWEST_TO_REJECT:
                good &= good_samples(left, OUTLIER, QUANTUM_PART * step)
    gain, at_device = state[:, 1:], record.at_device
    by_place = {}
    for name, slope in at_device.slopes.items() if at_device is not None else ():
        # A coil's field that is larger makes the gain smaller; the ambient field stays.
        by_gain = -gain @ slope
        by_place[name] = np.concatenate((-by_gain @ record.ambient_nT, by_gain.ravel()))
    return InCoil(state[:, 0], gain, covariance, freedom, sigma_nT, at_device, by_place)


def sound_mean(samples: Array) -> Array:
    """Return the mean of each column of samples (n, 3), wild ones left out; NaN of none."""
    good = np.column_stack([good_samples(column, OUTLIER) for column in samples.T])
    return np.asarray(
        np.where(good, samples, 0.0).sum(axis=0) / np.where(good, 1.0, 0.0).sum(axis=0)
    )


def _spans(applied: Array) -> bool:
    spread = np.linalg.svd(applied - applied.mean(axis=0), compute_uv=False)
    return bool(spread[-1] > SMALLEST_SPREAD * spread[0])


def coil_inputs(record: CoilRecord, source: str) -> Iterator[InputQuantity]:
    """Yield what the reference may be off."""
    read = record.reading or source
    stated = InputQuantity.if_stated
    yield stated(GAIN, "gain of the gaussmeter", record.gain_u, "1", read)
    yield stated(ZERO, "zero of the gaussmeter", record.zero_u_nT, "nT", read)
    about = "direction of the gaussmeter's axes to the sensor's"
    yield stated(ALIGNMENT, about, record.alignment_u_rad, "rad", source)
    if record.at_device is not None:
        yield from record.at_device.inputs
