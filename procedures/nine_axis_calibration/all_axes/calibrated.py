"""What the calibration file holds of accelerometers and magnetometer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .inertial import CROSS, K2, B, Inertial, K, N
from .magnetic import Magnetic
from .stands import Array

if TYPE_CHECKING:
    from .results import OtherResults

NAMES = "XYZ"
MATRIX = [row + column for row in NAMES for column in NAMES]


def other_sensors(others: OtherResults) -> dict[str, object]:
    """Return offsets, matrices and covariances of what is determined, by sensor."""
    data: dict[str, object] = {}
    if others.inertial is not None:
        data["accelerometers"] = accelerometers(others.inertial)
    if others.magnetic is not None and all(map(others.magnetic.determines, np.eye(12))):
        frame = "mounting" if others.inertial is None else "accelerometers"
        data["magnetometer"] = magnetometer(others.magnetic, frame)
    return data


def accelerometers(inertial: Inertial) -> dict[str, object]:
    """Return the accelerometers' calibration; its frame is their own."""
    shape = np.eye(3)
    for lean, (i, j) in zip(inertial.state[N], CROSS, strict=True):
        shape[i, j] = shape[j, i] = lean
    gain = inertial.state[K][:, None] * shape
    own = [*range(9)]  # bias, scale factor and non-orthogonality stand first
    names = [
        *(f"bias {axis}" for axis in NAMES),
        *(f"scale_factor {axis}" for axis in NAMES),
        *(f"half_nonorthogonality {NAMES[i]}{NAMES[j]}" for i, j in CROSS),
    ]
    return {
        "unit": "g",
        "frame": "accelerometers",
        "model": "output = bias + gain * force + second_order * force^2, gain = diag(scale "
        "factors) * (1 + half of the non-orthogonality, in rad)",
        "bias": _numbers(inertial.state[B]),
        "gain": _rows(gain),
        "inverse_gain": _rows(_inverse(gain)),
        "second_order": _numbers(inertial.state[K2]) if inertial.second_order else None,
        "covariance": {"names": names, "matrix": _rows(inertial.covariance[np.ix_(own, own)])},
    }


def magnetometer(magnetic: Magnetic, frame: str) -> dict[str, object]:
    """Return the magnetometer's calibration; soft iron and directions are in its gain."""
    names = [*(f"offset {axis}" for axis in NAMES), *(f"gain {pair}" for pair in MATRIX)]
    return {
        "unit": "nT",
        "frame": frame,
        "model": "output = offset + gain * field",
        "relative": magnetic.relative,
        "offset": _numbers(magnetic.offset_nT),
        "gain": _rows(magnetic.gain),
        "inverse_gain": _rows(_inverse(magnetic.gain)),
        "covariance": {"names": names, "matrix": _rows(magnetic.covariance)},
    }


def _inverse(matrix: Array) -> Array:
    inverse: Array = np.linalg.inv(matrix).astype(np.float64)
    return inverse


def _numbers(values: Array) -> list[float]:
    return [float(value) for value in values]


def _rows(matrix: Array) -> Sequence[list[float]]:
    return [_numbers(row) for row in matrix]
