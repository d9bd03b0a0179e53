"""What a run commands and records, step by step, and how long that takes.

How many sets of turns a ramp holds is decided by the gyros: they follow the chamber's air late and
are warmer than it by their own heat. On a ramp they are behind where they would come to rest by its
rate times their lag, and go on when it has ended.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from station.method.commands import Power
from station.method.motion import (
    AxisAtRate,
    AxisBy,
    AxisTo,
    ChamberOn,
    TemperatureRamp,
    TemperatureTo,
)
from station.method.set_points import Bounded, Bounds, Command
from station.method.work import Duration, Rows, Work, on_the_way
from station.procedure import RecordUse

from .parameters import FULL_TURN_DEG, SECONDS_PER_HOUR, FogParameters, Verification

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TABLE = "turntable"
CHAMBER = "thermal_chamber"
NAVIGATOR = "navigator"
POWER = "dut_power"
TEMPERATURE_RANGE = ("parameters", "temperature_range")
RAMP_RATE = ("parameters", "ramp_rate")
VERIFICATION_RATE = ("parameters", "verification", "ramp_rate")
TURN_RATE = ("parameters", "turn_rate")
EXPECTED_HEAT_DEGC = 5.0
"""By how much gyros warm themselves."""
EXPECTED_LAG_S = 2520.0
PROVED_WITHIN_DEGC = 2.0
"""So near to where the first turns were made the proof begins and ends; nearer takes hours."""
APPROACH_S = 2700.0
MIN_LEFT_DEGC = 0.1
CHAMBER_EVERY_S = 30.0
LOOK_S = 8.0
"""Run time between two looks; less where time runs by itself, so that a kill loses little. A run
that ends early takes first what has come since the last one."""
UP: dict[str, tuple[float, float]] = {"x": (90.0, 0.0), "y": (0.0, -90.0), "z": (0.0, 180.0)}
"""Angles of the middle and the inner axis, in deg, that let a body axis point up (z is down)."""


def instruments(parameters: FogParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    return (CHAMBER, TABLE, NAVIGATOR, POWER)


def records(parameters: FogParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: that a turn of the table is whole."""
    return (RecordUse(TABLE, "angle", 360.0, "deg", corrected=False),)


def soaking(parameters: FogParameters) -> Duration:
    """Return the bench time of step 1 beside its soak and its rotation: what is waited for."""
    rule = parameters.warm_up
    warm_s = max(_until_s(EXPECTED_HEAT_DEGC, left_degC(parameters)), rule.window_s)
    warm = Duration(
        min(warm_s, rule.at_most_s), rule.window_s, rule.at_most_s + rule.window_s / 60.0
    )
    aligned = _within(parameters.alignment_s, parameters.alignment_at_most_s)
    homed = on_the_way(parameters.reorientation_s)
    return homed + _approaching(parameters) + homed + aligned + warm


def _within(expected_s: float, at_most_s: float) -> Duration:
    """Return how long something is waited for that the plan gives a limit."""
    return Duration(min(expected_s, at_most_s), 0.0, at_most_s + LOOK_S)


def _approaching(parameters: FogParameters) -> Duration:
    """Return how long the chamber needs to a temperature."""
    return _within(APPROACH_S, parameters.chamber_at_most_s)


def turns_until(parameters: FogParameters, rate_degC_per_h: float, expected_s: float) -> Duration:
    """Return how long a ramp's turns go on: a set at least, and as long as the gyros lag at most.

    `expected_s` is that of the whole sets.
    """
    schedule, interval_s = parameters.schedule, parameters.set_interval_s
    least_s = schedule.axes * schedule.turns * FULL_TURN_DEG / schedule.rate_deg_per_s
    ramp_s = parameters.span_degC / rate_degC_per_h * SECONDS_PER_HOUR
    most_s = ramp_s + parameters.chamber_at_most_s + 2.0 * interval_s
    return Duration(min(expected_s, most_s), least_s, most_s)


def ramp_s(parameters: FogParameters) -> float:
    """Return the expected bench time in s of step 2: until the gyros are at the upper end."""
    behind_degC = _behind_degC(parameters, parameters.ramp_rate_degC_per_h)
    return _whole_sets_s(
        parameters, parameters.ramp_rate_degC_per_h, _until_s(behind_degC, EXPECTED_HEAT_DEGC)
    )


def proving(parameters: FogParameters, rule: Verification) -> Duration:
    """Return the bench time of step 4: cold again where it has to be, then the ramp with its turns.

    Before the turns the gyros come back into the range that the curve covers.
    """
    rate, most_s = rule.ramp_rate_degC_per_h, parameters.chamber_at_most_s
    behind_degC = _behind_degC(parameters, rate)
    near_degC = max(PROVED_WITHIN_DEGC - left_degC(parameters), MIN_LEFT_DEGC)
    back = _within(0.0, most_s)
    if rule.direction == "down":
        after_s = _until_s(behind_degC, near_degC)
        return back + turns_until(parameters, rate, _whole_sets_s(parameters, rate, after_s))
    cooled = _within(_until_s(parameters.span_degC, near_degC), most_s)
    after_s = _until_s(behind_degC, EXPECTED_HEAT_DEGC)
    turns = turns_until(parameters, rate, _whole_sets_s(parameters, rate, after_s))
    return _approaching(parameters) + cooled + back + turns


def sets_of_ramp(parameters: FogParameters) -> int:
    """Return how many sets of turns step 2 makes."""
    return round(ramp_s(parameters) / parameters.set_interval_s)


def left_degC(parameters: FogParameters) -> float:
    """Return how much warmer the gyros would still become when they count as warm."""
    slope_degC_per_s = parameters.warm_up.slope_limit_degC_per_h / SECONDS_PER_HOUR
    return min(slope_degC_per_s * EXPECTED_LAG_S, EXPECTED_HEAT_DEGC)


def _behind_degC(parameters: FogParameters, rate_degC_per_h: float) -> float:
    """Return how far behind the gyros are when a ramp over the plan's range ends."""
    lag_degC = rate_degC_per_h / SECONDS_PER_HOUR * EXPECTED_LAG_S
    return lag_degC * -math.expm1(-parameters.span_degC / lag_degC)


def _until_s(from_degC: float, to_degC: float) -> float:
    """Return the time in which the gyros come from one distance to another, nearer one."""
    return EXPECTED_LAG_S * math.log(max(from_degC / to_degC, 1.0))


def _whole_sets_s(parameters: FogParameters, rate_degC_per_h: float, after_s: float) -> float:
    """Return the time of the sets of turns that a ramp, and what comes after it, take."""
    ramp_s = parameters.span_degC / rate_degC_per_h * SECONDS_PER_HOUR
    sets = math.ceil((ramp_s + after_s) / parameters.set_interval_s - 1e-9) + 1
    return sets * parameters.set_interval_s


@dataclass(frozen=True)
class OnTheWay(Bounded):
    """The table goes to its angles as fast as the bench allows, and what is mounted on it, too."""

    def bounds(self, bench: Bench) -> Bounds:
        """Return the table's limit."""
        fastest = (
            bench.instruments[TABLE].limits.get("rate") if TABLE in bench.instruments else None
        )
        return {} if fastest is None else {"rate_deg_per_s": fastest}


def to_temperature(temperature_degC: float, text: str) -> TemperatureTo:
    """Return the command that brings the chamber's air to a temperature."""
    return TemperatureTo(CHAMBER, temperature_degC, text, decided_by=TEMPERATURE_RANGE)


def to_soak(parameters: FogParameters, temperature_degC: float) -> TemperatureTo:
    """Return the command that brings the chamber to where the run begins: the lowest, at first."""
    hours = parameters.soak_s / SECONDS_PER_HOUR
    return to_temperature(temperature_degC, f"soak of {hours:g} h")


def moves(text: str, **angles_deg: float) -> tuple[AxisTo, ...]:
    """Return the commands that bring axes of the table, by name, to angles."""
    return tuple(
        AxisTo(TABLE, axis, text, angle_deg=angle_deg, decided_by=TURN_RATE)
        for axis, angle_deg in angles_deg.items()
    )


def to_zero() -> tuple[AxisTo, ...]:
    """Return the moves of all axes to zero."""
    return moves("all axes to zero", outer=0.0, middle=0.0, inner=0.0)


def to_up(axis: str) -> tuple[AxisTo, ...]:
    """Return the moves that let a body axis point up."""
    middle_deg, inner_deg = UP[axis]
    text = f"{axis} up: middle and inner axis to {middle_deg:g} deg, {inner_deg:g} deg"
    return moves(text, middle=middle_deg, inner=inner_deg)


def turning(rate_deg_per_s: float, text: str, axis: str = "outer") -> AxisAtRate:
    """Return the command that lets an axis turn at a rate."""
    return AxisAtRate(TABLE, axis, text, None, rate_deg_per_s, decided_by=TURN_RATE)


def full_turns(parameters: FogParameters) -> Iterator[tuple[AxisAtRate, AxisBy]]:
    """Yield each turn about an axis that points up: its rate, and the angle at which it ends.

    Angles are bounded by where the outer axis stands at the first of them.
    """
    text = "turns of " + ", ".join(f"{sign * FULL_TURN_DEG:+g} deg" for sign in parameters.signs)
    for sign, place in zip(parameters.signs, accumulate(parameters.signs), strict=True):
        yield (
            turning(sign * parameters.turn_rate_deg_per_s, text),
            AxisBy(
                TABLE,
                "outer",
                text,
                angle_deg=sign * FULL_TURN_DEG,
                bound_deg=place * FULL_TURN_DEG,
                decided_by=TURN_RATE,
            ),
        )


def fitted_ramp(parameters: FogParameters) -> TemperatureRamp:
    """Return the ramp of step 2."""
    return TemperatureRamp(
        CHAMBER,
        parameters.temperature_range_degC[1],
        parameters.ramp_rate_degC_per_h,
        RAMP_RATE,
        decided_by=TEMPERATURE_RANGE,
    )


def proof_ramp(parameters: FogParameters, rule: Verification) -> TemperatureRamp:
    """Return the ramp of step 4."""
    low_degC, high_degC = parameters.temperature_range_degC
    end_degC = low_degC if rule.direction == "down" else high_degC
    rate = rule.ramp_rate_degC_per_h
    return TemperatureRamp(CHAMBER, end_degC, rate, VERIFICATION_RATE, decided_by=TEMPERATURE_RANGE)


def work(parameters: FogParameters) -> Iterator[Work]:
    """Yield soak and start, each ramp with a set of its turns, and the end."""
    rate: Bounds = {"rate_deg_per_s": parameters.turn_rate_deg_per_s}
    start: list[Command[Any]] = [
        ChamberOn(CHAMBER),
        to_soak(parameters, parameters.temperature_range_degC[0]),
        Power(POWER, True),
        Bounded(NAVIGATOR, f"outputs at {parameters.navigator_rate_Hz:g} Hz"),
        *to_zero(),
        OnTheWay(TABLE, "on the way to its angles", decided_by=TURN_RATE),
        OnTheWay(NAVIGATOR, "on the way to its angles", decided_by=TURN_RATE),
    ]
    if parameters.random_rotation_s > 0.0:
        text = "random rotation as fast as the turns"
        start.append(Bounded(TABLE, text, within=rate, decided_by=TURN_RATE))
    certain_s, soaked = parameters.soak_s + parameters.random_rotation_s, soaking(parameters)
    if parameters.random_rotation_s > 0.0:  # its last leg is stopped at the end of its time
        soaked += on_the_way(
            parameters.turn_rate_deg_per_s / parameters.turn_acceleration_deg_per_s2
        )
    silent_s = _approaching(parameters).expected_s + parameters.soak_s
    heard = rows(parameters, certain_s + soaked.expected_s, silent_s)
    yield Work("1", None, tuple(start), heard, certain_s, decided=soaked)
    ramps = turns_until(parameters, parameters.ramp_rate_degC_per_h, ramp_s(parameters))
    heard = rows(parameters, ramps.expected_s)
    yield Work("2", None, (fitted_ramp(parameters),), heard, decided=ramps)
    yield from set_of_turns("2", parameters)
    rule = parameters.verification
    if rule is not None:
        proved = proving(parameters, rule)
        heard = rows(parameters, proved.expected_s)
        yield Work("4", None, (proof_ramp(parameters, rule),), heard, decided=proved)
        yield from set_of_turns("4", parameters)
    yield Work("4", commands=(Power(POWER, False),))


def set_of_turns(step: str, parameters: FogParameters) -> Iterator[Work]:
    """Yield a set of turns of a ramp, whose time is that of the ramp."""
    text = next(full_turns(parameters))[0].text
    within: Bounds = {"rate_deg_per_s": parameters.turn_rate_deg_per_s}
    turns = [command for pair in full_turns(parameters) for command in pair]
    commands: list[Command[Any]] = []
    for axis in parameters.axes:
        commands += [*to_up(axis), *turns]
    commands.append(Bounded(NAVIGATOR, text, within=within, decided_by=TURN_RATE))
    yield Work(step, None, tuple(commands), repeats=True)


def rows(parameters: FogParameters, lasts_s: float, silent_s: float = 0.0) -> tuple[Rows, ...]:
    """Return the rows of the navigator, but while it is silent, and of the chamber."""
    heard_s = lasts_s - silent_s
    return (
        Rows(NAVIGATOR, heard_s, heard_s * parameters.navigator_rate_Hz),
        Rows(CHAMBER, lasts_s, lasts_s / CHAMBER_EVERY_S),
    )
