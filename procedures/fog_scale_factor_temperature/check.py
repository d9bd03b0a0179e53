"""Why a plan cannot run on a bench; nothing is energised to find out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.procedure import Problem, RecordUse
from station.roles.turntable import unnamed_axes

from .parameters import FogParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TABLE = "turntable"
CHAMBER = "thermal_chamber"
NAVIGATOR = "navigator"
POWER = "dut_power"
TURN_ACCELERATION = ("parameters", "turn_acceleration")
RESOLUTION = ("parameters", "heading_resolution")
ASKED = ("parameters", "asked_uncertainty")
DRIVE = ("parameters", "drive", "file")


def instruments(parameters: FogParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    return (CHAMBER, TABLE, NAVIGATOR, POWER)


def records(parameters: FogParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: that a turn of the table is whole."""
    return (RecordUse(TABLE, "angle", 360.0, "deg", corrected=False),)


def check(parameters: FogParameters, bench: Bench) -> Iterator[Problem]:
    """Yield a table not told or too slow, an uncertainty out of reach, a drive that is no drive.

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
    from .outlook import expected_uncertainty

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
    from station.files.faults import FaultList

    from .from_import import drive_in, inputs

    try:
        files = inputs(parameters)
    except FaultList as found:
        yield from (Problem(DRIVE, fault.said) for fault in found.faults)
        return
    try:
        for path in files.values():
            drive_in(path, parameters)
    except FaultList as found:
        yield from (Problem(DRIVE, str(fault)) for fault in found.faults)
