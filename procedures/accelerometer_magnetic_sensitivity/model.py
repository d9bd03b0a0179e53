"""The coupled model of an accelerometer in a magnetic field: thirteen columns, planes, nuisances.

    Y = K0 + Ki Ai + Kii Ai^2 + Kiii Ai^3 + Kio Ai Ao + Kip Ai Ap + Koo Ao^2 + Kpp Ap^2
      + Km Am + Kmm Am^2 + Kim Ai Am + Kom Ao Am + Kpm Ap Am

Y in V; Ai, Ao, Ap the acceleration along input, output and pendulous axis in g; Am the field in T.
Equation (2) of the source document; the formula is missing from the text at hand and was
reconstructed from its list of symbols and from the model (1) of IEEE Std 836 and 1293.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Names = NDArray[np.str_]

UNITS = {
    "K0": "V",
    "Ki": "V/g",
    "Kii": "V/g^2",
    "Kiii": "V/g^3",
    "Kio": "V/g^2",
    "Kip": "V/g^2",
    "Koo": "V/g^2",
    "Kpp": "V/g^2",
    "Km": "V/T",
    "Kmm": "V/T^2",
    "Kim": "V/g/T",
    "Kom": "V/g/T",
    "Kpm": "V/g/T",
}
COEFFICIENTS = tuple(UNITS)
"""The order in which columns are judged."""

FIELD_POWER = {"Km": 1, "Kmm": 2, "Kim": 1, "Kom": 1, "Kpm": 1}
"""By which power of the field each column grows; the others do not."""

PLANES = ("io", "ip", "op", "level")
"""The plane of IA, OA, PA that gravity turns in; `level`: the axis of rotation is vertical."""


def accelerations(plane: Names, theta_rad: Array, gravity_g: float = 1.0) -> Array:
    """Return Ai, Ao, Ap in g as columns (n, 3).

    The axis of rotation is horizontal and theta the angle of the table: `io` turns about PA with
    Ai = sin, Ao = cos; `ip` about OA with Ai = sin, Ap = cos; `op` about IA with Ao = sin,
    Ap = cos. In `level` it is vertical: Ap = 1 whatever theta. All times the local gravity.
    """
    sine, cosine = np.sin(theta_rad), np.cos(theta_rad)
    return gravity_g * _by_plane(plane, sine, cosine, 1.0)


def accelerations_by_angle(plane: Names, theta_rad: Array, gravity_g: float = 1.0) -> Array:
    """Return the derivatives of Ai, Ao, Ap by theta, g/rad, as columns (n, 3)."""
    return gravity_g * _by_plane(plane, np.cos(theta_rad), -np.sin(theta_rad), 0.0)


def _by_plane(plane: Names, first: Array, second: Array, level: float) -> Array:
    result = np.zeros((len(first), 3))
    in_io, in_ip, in_op = plane == "io", plane == "ip", plane == "op"
    result[:, 0] = np.where(in_io | in_ip, first, 0.0)
    result[:, 1] = np.where(in_io, second, np.where(in_op, first, 0.0))
    result[:, 2] = np.where(in_ip | in_op, second, np.where(plane == "level", level, 0.0))
    return result


def model_columns(acceleration_g: Array, field: Array) -> Array:
    """Return the thirteen columns (n, 13), in the order of `COEFFICIENTS`, for a field (n,)."""
    i, o, p = acceleration_g.T
    one = np.ones(len(field))
    still = (one, i, i**2, i**3, i * o, i * p, o**2, p**2)
    magnetic = (field, field**2, i * field, o * field, p * field)
    return np.column_stack((*still, *magnetic))


def model_columns_by_angle(acceleration_g: Array, change_g_per_rad: Array, field: Array) -> Array:
    """Return the derivatives of the thirteen columns by theta, per rad, (n, 13)."""
    i, o, p = acceleration_g.T
    di, do, dp = change_g_per_rad.T
    zero = np.zeros(len(field))
    still = (zero, di, 2 * i * di, 3 * i**2 * di, di * o + i * do, di * p + i * dp)
    square = (2 * o * do, 2 * p * dp)
    magnetic = (zero, zero, di * field, do * field, dp * field)
    return np.column_stack((*still, *square, *magnetic))


def field_scales(largest_T: float, names: Sequence[str] = COEFFICIENTS) -> Array:
    """Return what a column for the field over its largest magnitude is divided by, (k,)."""
    return np.array([largest_T ** FIELD_POWER.get(name, 0) for name in names])
