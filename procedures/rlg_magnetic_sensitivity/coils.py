"""The coils' fields on the three axes: their 3 x 3 response, and what one probe cannot see.

A gaussmeter of one axis is turned along each coil's normal in turn. The two other components are
taken as zero; that gyro and field do not lie exactly so is an uncertainty of type B.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.common.helmholtz import FieldAtDevice
from station.findings import Estimate

from .dataset import AXES, Array, Mask, Segment
from .fitted import LineDetail
from .parameters import COIL_OF_AXIS

MISALIGNMENT = "field_misalignment_rad"
PROBE_ANGLE = "angle"
"""The quantity of a calibration record that says how well the probe's direction is known."""


def components_T(rows: NDArray[Any]) -> Array:
    """Return the field by component, shape (rows, 3); NaN what the gaussmeter did not see."""
    return np.column_stack([rows[f"{coil}_T"] for coil in COIL_OF_AXIS.values()])


def unseen(field: Array) -> Mask:
    """Return which components of a record the gaussmeter never saw, shape (3,)."""
    return np.asarray(np.isnan(field).all(axis=0)) & bool(len(field))


def slope_by_misalignment(estimate: Estimate, others: Sequence[Estimate]) -> Mapping[str, float]:
    """Return by how much an estimate changes with the angle, two directions taken together.

    A field that leans by an angle towards another axis brings that axis's sensitivity in. An axis
    whose sensitivity is not known counts as much as the largest that is.
    """
    known = {
        estimate.axis: abs(estimate.value) for estimate in others if estimate.value is not None
    }
    largest = max(known.values(), default=0.0)
    across = [known.get(axis, largest) for axis in COIL_OF_AXIS if axis != estimate.axis]
    return {MISALIGNMENT: math.hypot(*across)}


def slopes_by_place(
    estimate: Estimate, others: Sequence[Estimate], at: FieldAtDevice | None
) -> Mapping[str, float]:
    """Return the derivatives of an estimate by where coils, probe and gyro are.

    A field b that is (1 + E) b makes sensitivities S, all solved together, into S - E' S.
    """
    if at is None:
        return {}
    values = {other.axis: other.value or 0.0 for other in others}
    known = np.array([values.get(axis, 0.0) for axis in AXES])
    slopes = at.by_input(COIL_OF_AXIS[estimate.axis or ""])
    return {name: -float(slope @ known) for name, slope in slopes.items()}


@dataclass(frozen=True)
class CoilResponse:
    """The measured field of one coil over the commanded one, on IA, NA, LA.

    `components` (3,) are the parts in phase with the coil's own field, `uncertainty` (3,) their
    standard uncertainties (type A; the gaussmeter's scale is left aside), `lean_deg` (3,) the
    angles by which the field leans from its own axis towards each; its own entry is the angle
    between field and axis. What a probe did not see is not a number.
    """

    axis: str
    components: Array
    uncertainty: Array
    lean_deg: Array
    lean_uncertainty_deg: Array


def coil_responses(
    lines: Sequence[LineDetail], segments: Sequence[Segment]
) -> Mapping[str, CoilResponse]:
    """Return the response of each coil that drives a line of its own, by the axis it drives.

    An axis that several records drive is taken from the first; where two axes share a frequency
    their fields cannot be distinguished, and neither is in the result.
    """
    responses: dict[str, CoilResponse] = {}
    for line in lines:
        commanded_mT = segments[line.segment].drive[line.axis].amplitude_mT
        shared = [other for other in lines if other.segment == line.segment]
        alone = sum(other.frequency_Hz == line.frequency_Hz for other in shared) == 1
        if (
            line.axis in responses
            or not alone
            or commanded_mT <= 0.0
            or abs(line.own_field_mT) <= 0.0
        ):
            continue
        responses[line.axis] = coil_response(line, commanded_mT)
    return responses


def coil_response(line: LineDetail, commanded_mT: float) -> CoilResponse:
    """Return the response of the coil behind a line."""
    own = AXES.index(line.axis)
    turned = line.field.phasor_mT * np.exp(-1j * np.angle(line.field.phasor_mT[own]))
    # A component that was not measured is zero throughout.
    seen = line.field.phasor_mT != 0.0
    field_mT = np.where(seen, turned.real, np.nan)
    u_mT = np.where(seen, np.sqrt(line.field.variance_mT2), np.nan)
    lean = np.arctan2(field_mT, field_mT[own])
    lean_u = u_mT / field_mT[own]
    unseen = (line.field.phasor_mT == 0.0) & (u_mT == 0.0)  # no noise at all: taken as zero
    across = np.delete(field_mT, own)
    lean[own] = np.arctan2(float(np.hypot(*across)), field_mT[own])
    lean_u[own] = float(np.max(np.delete(u_mT, own))) / field_mT[own]
    lean[unseen] = np.nan
    if unseen.any():
        lean[own] = np.nan
    return CoilResponse(
        line.axis,
        np.where(unseen, np.nan, field_mT / commanded_mT),
        u_mT / commanded_mT,
        np.degrees(lean),
        np.degrees(lean_u),
    )
