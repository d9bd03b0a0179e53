"""What `validate` says of a plan that has no fault: what it determines, and how well."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.orthogonal import independent_of, solve_by_qr
from procedures.estimation.slow_terms import FEWEST_LEFT
from station.findings import combination_text
from station.report.numbers import format_number

from .model import (
    COEFFICIENTS,
    UNITS,
    Identifiability,
    Names,
    accelerations,
    accelerations_by_angle,
    describe,
    judge,
    listed,
    model_columns,
)
from .nuisances import INDEPENDENT_PART, MOUNTING_RAD, folded
from .parameters import AccelerometerParameters

Array = NDArray[np.float64]
ENOUGH_ANGLES = 12
"""Of so many, three surely have something of their own."""
T_PER_MT = 1e-3
RAD_PER_MRAD = 1e-3


@dataclass(frozen=True)
class Expectation:
    """What a plan determines; `standard_uncertainty` of each kept coefficient in its own unit.

    It is None where the plan leaves fewer than three points beside its columns. `mounted` are the
    coefficients whose uncertainty holds a lean of the mounting. `angle_shows` is
    whether an encoder that is off at one angle shows in the residuals, and at which angle it is.
    """

    identifiability: Identifiability
    standard_uncertainty: Mapping[str, float | None]
    mounted: tuple[str, ...]
    angle_shows: bool


def expected_uncertainty(
    plane: Names,
    theta_deg: Array,
    field_T: Array,
    noise_V: float,
    scale_factor_V_per_g: float = 1.0,
) -> Expectation:
    """Return what a plan's points lead to, each argument (rows,).

    `noise_V` is the standard deviation of a point's output. Encoder offset and misalignment are in
    the Cramer-Rao bound of the noise wherever they are independent of the kept columns, as they are
    in the solution; elsewhere the mounting of `MOUNTING_RAD` is added, as the analysis does. Drift
    and temperature are not known beforehand.
    """
    determined = judge(plane, theta_deg, field_T)
    places = [COEFFICIENTS.index(name) for name in determined.kept]
    theta_rad = np.radians(theta_deg)
    acceleration_g = accelerations(plane, theta_rad)
    columns = model_columns(acceleration_g, field_T)[:, places]
    change = accelerations_by_angle(plane, theta_rad)
    zero = change[:, 0] * float("Ki" in determined.kept)
    other = np.column_stack((zero, acceleration_g[:, 1], acceleration_g[:, 2]))
    taken = independent_of(columns, other, INDEPENDENT_PART)
    design = np.column_stack((columns, other[:, list(taken)]))
    if len(theta_deg) - design.shape[1] < FEWEST_LEFT:
        return Expectation(determined, dict.fromkeys(determined.kept), (), angle_shows=False)
    inverse = solve_by_qr(design, np.zeros(len(theta_deg))).inverse_normal
    leans = np.array(list(folded(columns, other, taken).values())).reshape(-1, len(places))
    by_mounting = MOUNTING_RAD * scale_factor_V_per_g * np.linalg.norm(leans, axis=0)
    size = np.hypot(noise_V * np.sqrt(np.diag(inverse))[: len(places)], by_mounting)
    uncertainty = {name: float(size[j]) for j, name in enumerate(determined.kept)}
    mounted = tuple(name for j, name in enumerate(determined.kept) if by_mounting[j])
    shows = _angle_shows(design, plane, theta_deg, change[:, 0])
    return Expectation(determined, uncertainty, mounted, shows)


def _angle_shows(design: Array, plane: Names, theta_deg: Array, slope: Array) -> bool:
    """Whether three angles, each turned by itself, leave residuals of their own.

    Where only one does, all leave the same residual and none is distinguished; where two do, a
    drift in the published order leaves one.
    """
    places = sorted(set(zip(plane, theta_deg, strict=True)))[:ENOUGH_ANGLES]
    turned = [slope * ((plane == name) & (theta_deg == angle)) for name, angle in places]
    own = independent_of(design, np.column_stack(turned), INDEPENDENT_PART)
    return len(own) > 2 or not bool(np.any(slope))


def expectation(parameters: AccelerometerParameters) -> Expectation:
    """Return what the points of a plan determine, with the bounds of their uncertainties.

    A plan that repeats its points is as one with less noise: a thousand repeats cost no more here.
    """
    points = [point for point in parameters.points if point.number == 1]
    return expected_uncertainty(
        np.array([point.plane for point in points]),
        np.array([point.angle_deg for point in points]),
        np.array([point.field_mT for point in points]) * T_PER_MT,
        parameters.point_noise_V / math.sqrt(parameters.repeats),
        parameters.scale_factor_V_per_g,
    )


def undetermined(parameters: AccelerometerParameters) -> dict[str, str]:
    """Return each coefficient that a plan does not determine alone, and what it does instead."""
    determined = expectation(parameters).identifiability
    why: dict[str, str] = {}
    for name in determined.not_alone:
        together = [combination_text(own) for own in determined.terms.values() if name in own]
        if name in determined.kept:
            why[name] = f"this plan determines only {together[0]}; the limit is held against that"
            continue
        what = f"{name} alone, only {listed(together)}" if together else f"{name} at all"
        why[name] = (
            f"this plan does not determine {what}; its verdict will be inconclusive (exit code 6)"
        )
    return why


def outlook(parameters: AccelerometerParameters) -> tuple[str, ...]:
    """Return in lines what a plan determines, what it does not, and how well."""
    expected = expectation(parameters)
    determined = expected.identifiability
    lines = [f"{len(parameters.points)} points. {' '.join(describe(determined))}"]
    for name, terms in determined.terms.items():
        u = expected.standard_uncertainty[name]
        text = "undetermined: too few points" if u is None else f"u = {format_number(u, 2)}"
        lines.append(f"{combination_text(terms)}: {text} {UNITS[name] if u is not None else ''}")
    if expected.mounted:
        lines.append(
            f"No point tells a lean of the mounting from {listed(expected.mounted)}: u holds "
            f"{MOUNTING_RAD / RAD_PER_MRAD:g} mrad of it."
        )
    lines.append(
        "u here is that of noise and mounting; the calibration records, temperature and drift add "
        "to it."
    )
    if not expected.angle_shows:
        lines.append(
            "With so few angles an encoder that is off at one of them looks like a coefficient, or "
            "cannot be distinguished from another angle: take more angles or a second plane."
        )
    return tuple(line.rstrip() for line in lines)
