"""What a plan determines and how well, before anything moves; `validate` prints it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from station.report.numbers import format_number

from .curve import chebyshev_columns
from .dataset import FULL_TURN_DEG, PPM, SECONDS_PER_HOUR
from .forecast import sets_of_ramp
from .parameters import FogParameters

ARCSEC = 1.0 / 3600.0
GRID = 101


@dataclass(frozen=True)
class Expectation:
    """The bounds of a plan, in ppm; of one turn, and of a curve of the first order looked at.

    `rms_ppm` is over the range, `end_ppm` at its ends. `resolution_ppm` is the part of a turn's
    noise that the heading's resolution makes; `bias_ppm` what the gyro's bias makes of single
    turns, zero where turns of both senses cancel it.
    """

    sets: int
    turns: int
    turn_ppm: float
    resolution_ppm: float
    rms_ppm: float
    end_ppm: float
    bias_ppm: float

    @property
    def total_ppm(self) -> float:
        """The standard uncertainty to expect, rms over the range, bias included."""
        return float(np.hypot(self.rms_ppm, self.bias_ppm))


def expected_uncertainty(parameters: FogParameters) -> Expectation:
    """Return the Cramer-Rao bounds of a plan."""
    sets = sets_of_ramp(parameters)
    turns = sets * len(parameters.signs)
    turn_h = parameters.schedule.turn_s / SECONDS_PER_HOUR
    resolution = parameters.heading_resolution_deg / np.sqrt(6.0)
    walk = parameters.angle_random_walk_deg_per_sqrt_h * np.sqrt(turn_h)
    table = parameters.turntable_accuracy_arcsec * ARCSEC
    deg_to_ppm = PPM / FULL_TURN_DEG
    turn_ppm = float(np.sqrt(resolution**2 + walk**2 + table**2)) * deg_to_ppm
    bias_ppm = 0.0
    if len(parameters.signs) == 1 and parameters.gyro_bias_deg_per_h is not None:
        bias_ppm = parameters.gyro_bias_deg_per_h * turn_h * deg_to_ppm
    order = min(parameters.initial_order, sets - 1)
    domain = parameters.temperature_range_degC
    heat = np.repeat(np.linspace(*domain, sets), len(parameters.signs))
    columns = chebyshev_columns(heat, domain, order)
    inverse = np.linalg.inv(columns.T @ columns)
    grid = chebyshev_columns(np.linspace(*domain, GRID), domain, order)
    u = turn_ppm * np.sqrt(np.einsum("ij,jk,ik->i", grid, inverse, grid))
    return Expectation(
        sets,
        turns,
        turn_ppm,
        float(resolution * deg_to_ppm),
        float(np.sqrt(np.mean(u**2))),
        float(max(u[0], u[-1])),
        bias_ppm,
    )


def outlook(parameters: FogParameters) -> tuple[str, ...]:
    """Return in lines what a plan determines and how well."""
    expected = expected_uncertainty(parameters)
    schedule = parameters.schedule
    low, high = parameters.temperature_range_degC
    order = parameters.initial_order
    lines = [
        f"about {expected.sets} sets of {len(parameters.signs)} turns about each of "
        f"{', '.join(parameters.axes)}, {low:g} degC to {high:g} degC; a set takes "
        f"{schedule.set_s:.0f} s of {schedule.interval_s:g} s",
        f"noise of a turn {format_number(expected.turn_ppm, 2)} ppm, of which the heading's "
        f"resolution makes {format_number(expected.resolution_ppm, 2)} ppm",
        f"scale_factor_error, order {order}: u = {format_number(expected.rms_ppm, 2)} ppm over "
        f"the range, {format_number(expected.end_ppm, 2)} ppm at its ends",
    ]
    if expected.bias_ppm:
        lines.append(
            f"the gyro's bias adds u = {format_number(expected.bias_ppm, 2)} ppm, the same at all "
            "temperatures; turns: pairs would cancel it"
        )
    if parameters.outside:
        lines.append(f"outside the published range: {'; '.join(parameters.outside)}")
    return tuple(lines)
