"""Steps 4 to 7 as published: slowing-down factor from one shot, angles by the law of cosines.

    Q = gamma B_x / w_x,  B_xy = Q w_xy / gamma,  cos theta = (B_xy² - B_x² - B_y²) / (2 B_x B_y)

theta is the angle between the positive axes. The source takes the angle theta_1 inside the
triangle and then theta = pi - theta_1, which is the same; theta_1 would be 89 deg for 91 deg.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .angles import PLACES
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
        text = "no shot with a single coil gives the slowing-down factor"
        return PublishedAngles(dict.fromkeys(PAIRS), dict.fromkeys(PAIRS, text), None)
    alone_nT = float(np.linalg.norm(commanded_nT[single[0]]))
    factor = gamma_rad_per_s_nT * alone_nT / float(omega[single[0]])
    angles: dict[str, float | None] = dict.fromkeys(PAIRS)
    wanting: dict[str, str] = {}
    for pair, axes in PLACES.items():
        rows = np.flatnonzero(driven[:, axes].all(axis=1) & (driven.sum(axis=1) == 2) & good)
        if not len(rows):
            wanting[pair] = f"no usable shot drives {pair[0]} and {pair[1]}"
            continue
        # The source's shot has both fields positive; one of another polarity serves as well.
        k = int(max(rows, key=lambda row: bool(np.all(commanded_nT[row, axes] > 0.0))))
        one_nT, other_nT = commanded_nT[k, axes].tolist()
        total_nT = factor * float(omega[k]) / gamma_rad_per_s_nT
        cosine = (total_nT**2 - one_nT**2 - other_nT**2) / (2.0 * one_nT * other_nT)
        if abs(cosine) > 1.0:
            wanting[pair] = f"the cosine would be {cosine:.3g}"
        else:
            angles[pair] = float(np.degrees(np.arccos(cosine)))
    return PublishedAngles(angles, wanting, factor)


def closed_form(commanded_nT: Array, omega: Array) -> dict[str, float]:
    """Return the cosine of each pair of coils whose four polarities were measured at equal fields.

    Mean of w² over the four is a_i² B_i² + a_j² B_j² + residual², its contrast 2 a_i a_j B_i B_j
    cos; the three pairs together give the a. Empty where a pair is wanting.
    """
    means, contrasts = [], []
    for i, j in PLACES.values():
        inside = (commanded_nT[:, [i, j]] != 0.0).all(axis=1) & (commanded_nT[:, 3 - i - j] == 0.0)
        rows, square = commanded_nT[inside][:, [i, j]], omega[inside] ** 2
        signs, polarity = np.unique(np.sign(rows), axis=0, return_inverse=True)
        if len(signs) < 4 or float(np.ptp(np.abs(rows), axis=0).max()) > 0.0:
            return {}
        of_polarity = np.bincount(polarity.ravel(), square) / np.bincount(polarity.ravel())
        means.append(of_polarity.mean())
        contrasts.append(np.mean(of_polarity * signs.prod(axis=1)))
    # Each mean is the sum of two coils' squares: half of all, less the pair without a coil.
    x, y, z = squares = 0.5 * sum(means) - np.array(means)[::-1]
    if min(squares) <= 0.0:
        return {}
    sizes = np.sqrt([x * y, x * z, y * z])
    return dict(zip(PAIRS, (np.array(contrasts) / (2.0 * sizes)).tolist(), strict=True))
