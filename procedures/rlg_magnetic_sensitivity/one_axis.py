"""A gaussmeter of one axis: what it cannot see of the field, and what is known of that.

Its probe is turned along each coil's normal in turn. The two other components are taken as zero;
that the gyro's axes and the field do not stand exactly so is an uncertainty of type B.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.rlg_magnetic_sensitivity.parameters import COIL_OF_AXIS
from station.findings import Estimate, InputQuantity

NAME = "field_misalignment_rad"
ANGLE = "angle"
"""The quantity of a calibration record that says how well the probe's direction is known."""


def components_T(rows: NDArray[Any]) -> NDArray[np.float64]:
    """Return the field by component, shape (rows, 3); NaN what the gaussmeter did not see."""
    return np.column_stack([rows[f"{coil}_T"] for coil in COIL_OF_AXIS.values()])


def unseen(field: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which components of a record the gaussmeter never saw, shape (3,)."""
    return np.asarray(np.isnan(field).all(axis=0)) & bool(len(field))


def misalignment(u_rad: float, source: str, *, unseen: bool) -> InputQuantity:
    """Return the angle between the measured field and the gyro's axis, zero with an uncertainty.

    `unseen`: the gaussmeter sees one component alone.
    """
    about = "direction of the gaussmeter's axes to those of the gyro"
    if unseen:
        about = (
            "components of the field that a probe of one axis does not see: angle to the gyro's "
            "axis"
        )
    return InputQuantity(NAME, about, u_rad, "1", source)


def slope_by_misalignment(estimate: Estimate, others: Sequence[Estimate]) -> Mapping[str, float]:
    """Return by how much an estimate changes with the angle, two directions taken together.

    A field that leans by an angle towards another axis brings that axis's sensitivity in. An axis
    whose sensitivity is not known counts as much as the largest that is.
    """
    known = {one.axis: abs(one.value) for one in others if one.value is not None}
    largest = max(known.values(), default=0.0)
    across = [known.get(axis, largest) for axis in COIL_OF_AXIS if axis != estimate.axis]
    return {NAME: math.hypot(*across)}
