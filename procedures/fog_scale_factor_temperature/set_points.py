"""What a run will command and record, step by step; no instrument is opened to say so."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate
from typing import TYPE_CHECKING

from station.method.set_points import SetPoint
from station.method.work import Forecast, Recording

from .bench_work import CHAMBER_EVERY_S, UP
from .check import CHAMBER, NAVIGATOR, POWER, TABLE
from .dataset import FULL_TURN_DEG
from .forecast import APPROACH_S, proof_s, ramp_s, soak_s
from .parameters import FogParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TEMPERATURE_RANGE = ("parameters", "temperature_range")
RAMP_RATE = ("parameters", "ramp_rate")
VERIFICATION_RATE = ("parameters", "verification", "ramp_rate")
TURN_RATE = ("parameters", "turn_rate")
MINUTES_PER_HOUR = 60.0


def forecast(parameters: FogParameters, bench: Bench) -> Forecast:
    """Return the set-points of all steps and the rows of navigator and chamber."""
    return Forecast(
        (*soaked(parameters, bench), *turned(parameters), *proved(parameters)),
        recordings(parameters),
        {CHAMBER: TEMPERATURE_RANGE, TABLE: TURN_RATE, NAVIGATOR: TURN_RATE},
    )


def soaked(parameters: FogParameters, bench: Bench) -> Iterator[SetPoint]:
    """Yield what step 1 commands."""
    low_degC, _ = parameters.temperature_range_degC
    rate = parameters.turn_rate_deg_per_s
    hours = parameters.soak_s / 3600.0
    yield SetPoint("1", CHAMBER, f"soak of {hours:g} h", temperature_degC=low_degC)
    yield SetPoint("1", POWER, "on")
    yield SetPoint("1", NAVIGATOR, f"outputs at {parameters.navigator_rate_Hz:g} Hz")
    yield SetPoint("1", TABLE, "all axes to zero", angle_deg=0.0)
    # As fast as the bench allows, and the navigator with it.
    fastest = bench.instruments[TABLE].limits.get("rate") if TABLE in bench.instruments else None
    for turning in (TABLE, NAVIGATOR):
        yield SetPoint("1", turning, "on the way to its angles", rate_deg_per_s=fastest)
    if parameters.random_rotation_s > 0.0:
        yield SetPoint("1", TABLE, "random rotation as fast as the turns", rate_deg_per_s=rate)


def turned(parameters: FogParameters) -> Iterator[SetPoint]:
    """Yield what step 2 commands, a set of turns once for all."""
    _, high_degC = parameters.temperature_range_degC
    ramp = parameters.ramp_rate_degC_per_h
    yield SetPoint("2", CHAMBER, f"ramp to {high_degC:g} degC", temperature_degC=high_degC)
    yield ramp_of("2", ramp, RAMP_RATE)
    yield from set_of_turns("2", parameters)


def proved(parameters: FogParameters) -> Iterator[SetPoint]:
    """Yield what step 4 commands; the set-point of its ramp's end was commanded before."""
    rule = parameters.verification
    if rule is not None:
        yield ramp_of("4", rule.ramp_rate_degC_per_h, VERIFICATION_RATE)
        yield from set_of_turns("4", parameters)
    yield SetPoint("4", POWER, "off")


def ramp_of(step: str, rate_degC_per_h: float, decided_by: tuple[str, ...]) -> SetPoint:
    """Return the slope of a ramp."""
    return SetPoint(
        step,
        CHAMBER,
        f"ramp at {rate_degC_per_h:g} degC/h",
        temperature_slew_degC_per_min=rate_degC_per_h / MINUTES_PER_HOUR,
        decided_by=decided_by,
    )


def set_of_turns(step: str, parameters: FogParameters) -> Iterator[SetPoint]:
    """Yield the angles that turn each axis up, and its turns from there on.

    The angles of the turns are those from where the outer axis stands at the first of them.
    """
    rate = parameters.turn_rate_deg_per_s
    for axis in parameters.axes:
        words = f"{axis} up: middle and inner axis to {', '.join(f'{a:g} deg' for a in UP[axis])}"
        for angle_deg in filter(None, UP[axis]):
            yield SetPoint(step, TABLE, words, angle_deg=angle_deg)
    turns = ", ".join(f"{sign * FULL_TURN_DEG:+g} deg" for sign in parameters.signs)
    places = set(accumulate(parameters.signs)) - {0}
    for angle_deg in sorted(place * FULL_TURN_DEG for place in places):
        words = f"turns of {turns}"
        yield SetPoint(step, TABLE, words, rate_deg_per_s=rate, angle_deg=angle_deg)
    yield SetPoint(step, NAVIGATOR, f"turns of {turns}", rate_deg_per_s=rate)


def recordings(parameters: FogParameters) -> tuple[Recording, ...]:
    """Return the rows of the navigator, from when it is switched on, and of the chamber."""
    whole_s = soak_s(parameters) + ramp_s(parameters) + proof_s(parameters)
    told_s = whole_s - APPROACH_S - parameters.soak_s
    return (
        Recording(NAVIGATOR, round(told_s * parameters.navigator_rate_Hz), told_s),
        Recording(CHAMBER, round(whole_s / CHAMBER_EVERY_S), whole_s),
    )
