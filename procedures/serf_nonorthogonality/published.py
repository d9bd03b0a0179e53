"""Steps 4 to 7 as published: slowing-down factor from one shot, angles by the law of cosines.

    Q = gamma B_x / w_x,  B_xy = Q w_xy / gamma,  cos theta = (B_xy² - B_x² - B_y²) / (2 B_x B_y)

theta is the angle between the positive axes. The source takes the angle theta_1 inside the triangle
and then theta = pi - theta_1, which is the same; theta_1 itself would be 89 deg for 91 deg.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .shots import PAIRS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PublishedAngles:
    """Angles in deg by pair, None where the rule cannot run, with the reason; and the factor."""

    angles_deg: dict[str, float | None]
    wanting: dict[str, str]
    slowing_down: float | None


def published_angles(
    commanded_nT: Array, omega: Array, gamma_rad_per_s_nT: float
) -> PublishedAngles:
    """Return the published angles from the first shot of each kind, coils taken for exact.

    `commanded_nT` (n, 3), `omega` (n,) in rad/s, NaN for a shot without one.
    """
    driven = commanded_nT != 0.0
    good = np.isfinite(omega)
    single = np.flatnonzero((driven.sum(axis=1) == 1) & good)
    if not len(single):
        said = "no shot with a single coil gives the slowing-down factor"
        return PublishedAngles(dict.fromkeys(PAIRS), dict.fromkeys(PAIRS, said), None)
    first = int(single[0])
    alone_nT = float(np.linalg.norm(commanded_nT[first]))
    factor = gamma_rad_per_s_nT * alone_nT / float(omega[first])
    angles: dict[str, float | None] = {}
    wanting: dict[str, str] = {}
    for pair in PAIRS:
        axes = ["xyz".index(axis) for axis in pair]
        wanted = np.zeros(3, dtype=bool)
        wanted[axes] = True
        rows = np.flatnonzero(np.all(driven == wanted, axis=1) & good)
        angles[pair] = None
        if not len(rows):
            wanting[pair] = f"no usable shot drives {pair[0]} and {pair[1]}"
            continue
        # The source's shot has both fields positive; one of another polarity serves as well.
        positive = [k for k in rows if bool(np.all(commanded_nT[k, axes] > 0.0))]
        k = int(positive[0] if positive else rows[0])
        one_nT, other_nT = (float(commanded_nT[k, axis]) for axis in axes)
        total_nT = factor * float(omega[k]) / gamma_rad_per_s_nT
        cosine = (total_nT**2 - one_nT**2 - other_nT**2) / (2.0 * one_nT * other_nT)
        if abs(cosine) > 1.0:
            wanting[pair] = f"the cosine would be {cosine:.3g}"
            continue
        angles[pair] = float(np.degrees(np.arccos(cosine)))
    return PublishedAngles(angles, wanting, factor)
