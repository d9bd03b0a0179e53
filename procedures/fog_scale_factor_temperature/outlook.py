"""What a plan determines and how well, and why it cannot run; nothing is energised for either."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.places import record_uses
from station.files.faults import FaultList
from station.procedure import Problem, RecordUse
from station.report.numbers import format_number
from station.roles.turntable import unnamed_axes

from .following import NAVIGATOR, ROOM_DEGC, TABLE
from .parameters import FogParameters
from .ramping import sets_of_ramp

if TYPE_CHECKING:
    from station.instruments.bench import Bench

ARCSEC, PPM = 1.0 / 3600.0, 1e6
GRID = 101
TURN_ACCELERATION = ("parameters", "turn_acceleration")
RESOLUTION = ("parameters", "heading_resolution")
ASKED = ("parameters", "asked_uncertainty")
DRIVE = ("parameters", "drive", "file")
RUNS = ("uncompensated", "compensated")
ERRORS = ("position_error", "final_position_error", "velocity_error")
NAVIGATED = tuple(f"{name}_{run}" for name in ERRORS for run in RUNS)


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
        return math.hypot(self.rms_ppm, self.bias_ppm)


def records(parameters: FogParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records.

    That a turn of the table is whole; how well the navigator reads the gyros' temperature, and a
    thermometer with places that of the device.
    """
    return (
        RecordUse(TABLE, "angle", FULL_TURN_DEG, "deg", corrected=False),
        RecordUse(NAVIGATOR, "temperature", ROOM_DEGC, "degC", needed=False, corrected=False),
        *record_uses(bench),
    )


def measured_axes(parameters: FogParameters) -> Mapping[str, tuple[str, ...]]:
    """Return the axes that a plan measures; of a proof and a drive none where it has none."""
    measured: tuple[str, ...] = parameters.axes
    verified = measured if parameters.verification is not None else ()
    headings, drive = [f"heading_error_{run}" for run in RUNS], parameters.drive
    return {
        **dict.fromkeys(headings if drive is None else (), ()),
        **dict.fromkeys(NAVIGATED if drive is None or drive.reference is None else (), ()),
        "scale_factor_error": measured,
        "largest_scale_factor_error": measured,
        "residual_scale_factor_error": verified,
    }


def expected_uncertainty(parameters: FogParameters) -> Expectation:
    """Return the Cramer-Rao bounds of a plan."""
    import numpy as np

    from .curve import chebyshev_columns

    sets = sets_of_ramp(parameters, parameters.ramp_rate_degC_per_h)
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


def check(parameters: FogParameters, bench: Bench) -> Iterator[Problem]:
    """Yield axes without a number, a slow table, an uncertainty out of reach, a wrong drive file.

    Rates, angles, temperatures and ramps beyond a limit are found from the forecast.
    """
    yield from table_problems(parameters, bench)
    yield from uncertainty_problems(parameters)
    yield from drive_problems(parameters)


def table_problems(parameters: FogParameters, bench: Bench) -> Iterator[Problem]:
    """Yield each axis whose number the bench file does not say, and turns quicker than possible.

    The number of an axis decides a sign.
    """
    table = bench.instruments.get(TABLE)
    if table is None:
        return
    for what in unnamed_axes(TABLE, table.settings):
        yield Problem(("procedure",), what)
    counted, allowed = parameters.turn_acceleration_deg_per_s2, table.limits.get("acceleration")
    if allowed is not None and counted > allowed:
        yield Problem(
            TURN_ACCELERATION,
            f"the times of the turns count with {counted:g} deg/s^2, which is more than the "
            f"{allowed:g} deg/s^2 that the bench allows for {TABLE}",
        )


def uncertainty_problems(parameters: FogParameters) -> Iterator[Problem]:
    """Yield why the uncertainty that the plan asks for cannot be reached."""
    asked = parameters.asked_uncertainty_ppm
    if asked is None:
        return
    expected = expected_uncertainty(parameters)
    if expected.total_ppm <= asked:
        return
    what = f"u = {expected.total_ppm:.2g} ppm is to be expected where {asked:g} ppm is asked for"
    if expected.bias_ppm > expected.rms_ppm:
        bias = f"the gyro's bias makes {expected.bias_ppm:.2g} ppm of single turns"
        yield Problem(("parameters", "turns"), f"{bias}: {what}; take turns: pairs")
    elif expected.resolution_ppm > 0.7 * expected.turn_ppm:
        yield Problem(
            RESOLUTION,
            f"a resolution of {parameters.heading_resolution_deg:g} deg makes "
            f"{expected.resolution_ppm:.2g} ppm of every turn: {what}; read a finer heading, or "
            "take more turns",
        )
    else:
        yield Problem(ASKED, f"{what}; take more turns (turns: pairs or +--+), or a slower ramp")


def drive_problems(parameters: FogParameters) -> Iterator[Problem]:
    """Yield why the file of the vehicle test cannot be used."""
    from .from_import import drive_in, inputs

    try:
        files = inputs(parameters)
    except FaultList as error:
        yield from (Problem(DRIVE, fault.said) for fault in error.faults)
        return
    try:
        drive_in(files, parameters)
    except FaultList as error:
        yield from (Problem(DRIVE, str(fault)) for fault in error.faults)
