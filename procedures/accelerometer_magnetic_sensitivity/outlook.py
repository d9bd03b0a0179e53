"""What `validate` says of a plan that has no fault: what it determines, and how well."""

from __future__ import annotations

import math

import numpy as np

from procedures.accelerometer_magnetic_sensitivity.expected import (
    Expectation,
    expected_uncertainty,
)
from procedures.accelerometer_magnetic_sensitivity.identifiability import (
    describe,
    listed,
)
from procedures.accelerometer_magnetic_sensitivity.model import UNITS
from procedures.accelerometer_magnetic_sensitivity.parameters import AccelerometerParameters
from station.findings import combination_text
from station.report.numbers import format_number

T_PER_MT = 1e-3


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
    )


def undetermined(parameters: AccelerometerParameters) -> dict[str, str]:
    """Return each coefficient that a plan does not determine alone, and what it does instead."""
    found = expectation(parameters).identifiability
    said: dict[str, str] = {}
    for name in found.not_alone:
        together = [combination_text(own) for own in found.terms.values() if name in own]
        if name in found.kept:
            said[name] = f"this plan determines only {together[0]}; the limit is held against that"
            continue
        what = f"not {name} alone, only {listed(together)}" if together else f"no {name} at all"
        said[name] = f"this plan determines {what}; its verdict will be inconclusive (exit code 6)"
    return said


def outlook(parameters: AccelerometerParameters) -> tuple[str, ...]:
    """Return in lines what a plan determines, what it does not, and how well."""
    expected = expectation(parameters)
    found = expected.identifiability
    lines = [f"{len(parameters.points)} points. {' '.join(describe(found))}"]
    for name, terms in found.terms.items():
        u = expected.standard_uncertainty[name]
        text = "undetermined: too few points" if u is None else f"u = {format_number(u, 2)}"
        lines.append(f"{combination_text(terms)}: {text} {UNITS[name] if u is not None else ''}")
    if not expected.angle_shows:
        lines.append(
            "With so few angles an encoder that is off at one of them looks like a coefficient, or "
            "cannot be told from another angle: take more angles or a second plane."
        )
    return tuple(line.rstrip() for line in lines)
