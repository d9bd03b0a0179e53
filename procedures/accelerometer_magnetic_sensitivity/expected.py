"""What a plan will determine and how well, before anything moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.orthogonal import independent_of, solve_by_qr

from .identifiability import Identifiability, judge
from .model import COEFFICIENTS, Names, accelerations, accelerations_by_angle, model_columns
from .nuisances import FEWEST_LEFT, INDEPENDENT_PART

Array = NDArray[np.float64]

ENOUGH_ANGLES = 12
"""Of so many, three surely have something of their own."""


@dataclass(frozen=True)
class Expectation:
    """What a plan determines; `standard_uncertainty` of each kept coefficient in its own unit.

    It is None where the plan leaves fewer than three points beside its columns. `angle_shows` is
    whether an encoder that is off at one angle shows in the residuals, and at which angle it is.
    """

    identifiability: Identifiability
    standard_uncertainty: Mapping[str, float | None]
    angle_shows: bool


def expected_uncertainty(
    plane: Names, theta_deg: Array, field_T: Array, noise_V: float
) -> Expectation:
    """Return the Cramer-Rao bounds of a plan's points, each argument (rows,).

    `noise_V` is the standard deviation of a point's output. Encoder offset and misalignment are in
    the bound wherever they are independent of the kept columns, as they are in the solution; drift
    and temperature are not known beforehand.
    """
    found = judge(plane, theta_deg, field_T)
    places = [COEFFICIENTS.index(name) for name in found.kept]
    theta_rad = np.radians(theta_deg)
    acceleration_g = accelerations(plane, theta_rad)
    columns = model_columns(acceleration_g, field_T)[:, places]
    change = accelerations_by_angle(plane, theta_rad)
    other = np.column_stack((change[:, 0], acceleration_g[:, 1], acceleration_g[:, 2]))
    taken = independent_of(columns, other, INDEPENDENT_PART)
    design = np.column_stack((columns, other[:, list(taken)]))
    if len(theta_deg) - design.shape[1] < FEWEST_LEFT:
        return Expectation(found, dict.fromkeys(found.kept), angle_shows=False)
    inverse = solve_by_qr(design, np.zeros(len(theta_deg))).inverse_normal
    size = noise_V * np.sqrt(np.diag(inverse))
    uncertainty = {name: float(size[j]) for j, name in enumerate(found.kept)}
    return Expectation(found, uncertainty, _angle_shows(design, plane, theta_deg, change[:, 0]))


def _angle_shows(design: Array, plane: Names, theta_deg: Array, slope: Array) -> bool:
    """Whether three angles, each turned by itself, leave residuals of their own.

    Where only one does, all leave the same residual and none can be told from the others; where two
    do, a drift in the published order leaves one.
    """
    places = sorted(set(zip(plane, theta_deg, strict=True)))[:ENOUGH_ANGLES]
    turned = [slope * ((plane == name) & (theta_deg == angle)) for name, angle in places]
    own = independent_of(design, np.column_stack(turned), INDEPENDENT_PART)
    return len(own) > 2 or not bool(np.any(slope))
