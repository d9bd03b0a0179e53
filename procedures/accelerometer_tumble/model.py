"""The model of an accelerometer that gravity turns in, and what of it a plan determines.

    E = K0 + Ki ai + Kii ai^2 + Kiii ai^3 + Kio ai ao + Kip ai ap + Koo ao^2 + Kpp ap^2
      + Kop ao ap + Kf cos(theta) + Ko ao + Kp ap

E in V; ai, ao, ap the acceleration along input, output and pendulous axis in g. Kf, the scale
factor times the fixture's error, is alike in all mountings. After the contents of IEEE Std 1293.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.folding import Terms, folded_terms

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
    "Kop": "V/g^2",
    "Kf": "V/g",
    "Ko": "V/g",
    "Kp": "V/g",
}
COEFFICIENTS = tuple(UNITS)
"""The order in which columns are judged."""
GRAVITY_POWER = {"V": 0, "V/g": 1, "V/g^2": 2, "V/g^3": 3}
PLANES = ("io", "ip")


def model_columns(plane: Names, reverse: Array, theta_rad: Array, gravity_g: float) -> Array:
    """Return the twelve columns (n, 12), in the order of `COEFFICIENTS`.

    `plane` `io` has ai = sin, ao = cos; `ip` has ai = sin, ap = cos; the third axis is level.
    `reverse` (n,) is -1 where the unit is turned by 180 deg about its input axis, else 1.
    """
    i, cosine = gravity_g * np.sin(theta_rad), gravity_g * np.cos(theta_rad)
    o = np.where(plane == "io", reverse * cosine, 0.0)
    p = np.where(plane == "ip", reverse * cosine, 0.0)
    squares = (i * o, i * p, o**2, p**2, o * p)
    return np.column_stack((np.ones(len(i)), i, i**2, i**3, *squares, cosine, o, p))


def judge(plane: Names, reverse: Array, theta_rad: Array, gravity_g: float) -> Terms:
    """Return what commanded angles determine: kept coefficients and the combinations they are."""
    columns = model_columns(plane, reverse, theta_rad, gravity_g)
    return folded_terms(COEFFICIENTS, columns, np.ones(len(COEFFICIENTS)))
