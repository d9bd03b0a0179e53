"""Why a plan cannot run on a bench; nothing is energised to find out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.fog_scale_factor_temperature.drive_file import drive_in, inputs
from procedures.fog_scale_factor_temperature.parameters import FogParameters
from station.procedure import Problem

if TYPE_CHECKING:
    from station.bench import Bench

TABLE = "turntable"
CHAMBER = "thermal_chamber"
NAVIGATOR = "navigator"
POWER = "dut_power"
TEMPERATURE_RANGE = ("parameters", "temperature_range")
RAMP_RATE = ("parameters", "ramp_rate")
TURN_RATE = ("parameters", "turn_rate")
RESOLUTION = ("parameters", "heading_resolution")
ASKED = ("parameters", "asked_uncertainty")
DRIVE = ("parameters", "drive", "file")
MINUTES_PER_HOUR = 60.0


def instruments(parameters: FogParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    return (CHAMBER, TABLE, NAVIGATOR, POWER)


def check(parameters: FogParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the chamber cannot do, an uncertainty out of reach, a drive that is no drive."""
    yield from table_problems(bench)
    yield from chamber_problems(parameters, bench)
    yield from uncertainty_problems(parameters)
    yield from drive_problems(parameters)


def table_problems(bench: Bench) -> Iterator[Problem]:
    """Yield each axis of the table whose number the bench file does not say: it decides a sign."""
    table = bench.instruments.get(TABLE)
    for key in ("outer_axis", "middle_axis", "inner_axis") if table is not None else ():
        if table is not None and not isinstance(table.settings.get(key), int):
            yield Problem(
                ("procedure",),
                f"the bench file does not say which axis of {TABLE} is the {key[:-5]} one; write "
                f"instruments.{TABLE}.settings.{key}, such as 1",
            )


def chamber_problems(parameters: FogParameters, bench: Bench) -> Iterator[Problem]:
    """Yield each temperature and ramp that the bench does not allow for its chamber."""
    chamber = bench.instruments.get(CHAMBER)
    if chamber is None:
        return
    lowest = chamber.limits.get("temperature_low")
    highest = chamber.limits.get("temperature_high")
    low, high = parameters.temperature_range_degC
    if lowest is not None and low < lowest:
        yield Problem(
            TEMPERATURE_RANGE,
            f"{low:g} degC is below the {lowest:g} degC that the bench allows for {CHAMBER}",
        )
    if highest is not None and high > highest:
        yield Problem(
            TEMPERATURE_RANGE,
            f"{high:g} degC is above the {highest:g} degC that the bench allows for {CHAMBER}",
        )
    fastest = chamber.limits.get("temperature_slew")
    ramps: list[tuple[tuple[str, ...], float]] = [(RAMP_RATE, parameters.ramp_rate_degC_per_h)]
    if parameters.verification is not None:
        own = ("parameters", "verification", "ramp_rate")
        ramps.append((own, parameters.verification.ramp_rate_degC_per_h))
    for where, rate in ramps:
        if fastest is not None and rate / MINUTES_PER_HOUR > fastest * (1.0 + 1e-9):
            yield Problem(
                where,
                f"{rate:g} degC/h is faster than the {fastest * MINUTES_PER_HOUR:g} degC/h that "
                f"the bench allows for {CHAMBER}",
            )


def uncertainty_problems(parameters: FogParameters) -> Iterator[Problem]:
    """Yield why the uncertainty that the plan asks for cannot be reached."""
    from procedures.fog_scale_factor_temperature.expected import expected_uncertainty

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
    from station.faults import FaultList

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
