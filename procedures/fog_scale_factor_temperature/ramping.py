"""Ramps of the chamber with sets of turns: of the fit and of the proof; a ramp may be resumed.

How many sets of turns a ramp holds is decided by the gyros: they follow the chamber's air late and
are warmer than it by their own heat. On a ramp they are behind where they would come to rest by its
rate times their lag, and go on when it has ended.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import accumulate, count
from typing import TYPE_CHECKING, Any

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from station.errors import ConditionNotReached
from station.method.duration import Duration, exactly, on_the_way
from station.method.motion import AxisAtRate, AxisBy, AxisTo, TemperatureRamp
from station.method.set_points import Bounded, Bounds
from station.method.verbs import axis_of

from .following import (
    CHAMBER,
    NAVIGATOR,
    PROOF,
    RAMP,
    TABLE,
    Following,
)
from .parameters import AXES, FogParameters

if TYPE_CHECKING:
    from station.method.run import Run

TURN_RATE = ("parameters", "turn_rate")
EXPECTED_HEAT_DEGC = 5.0
"""By how much gyros warm themselves."""
EXPECTED_LAG_S = 2520.0
PROVED_WITHIN_DEGC = 2.0
"""So near to where the first turns were made the proof begins and ends; nearer takes hours."""
MIN_LEFT_DEGC = 0.1
TURNING_LOOK_S = 2.0
SHORT_OF_TURN_S = 1.0
"""The axis goes to its angle when it is so near to it: it brakes, then covers the rest."""
UP: dict[str, tuple[float, float]] = {"x": (90.0, 0.0), "y": (0.0, -90.0), "z": (0.0, 180.0)}
"""Angles of the middle and the inner axis, in deg, that let a body axis point up (z is down)."""


@dataclass(frozen=True)
class Ramp:
    """A ramp: the chamber goes to its end, the turns go on until the gyros pass a temperature.

    Gyros that are switched on never become as cold as the chamber.
    """

    name: str
    command: TemperatureRamp
    gyros_degC: float
    upwards: bool

    @property
    def end(self) -> str:
        """The unit that is finished when the ramp is."""
        return f"end of {self.name}"

    def takes(self, run: Run, first: int) -> Duration:
        """Return how long its turns go on from set `first`, and as long as the gyros lag at most.

        What is left of that set is made at least.
        """
        parameters: FogParameters = run.parameters
        rate, interval_s = self.command.rate_degC_per_h, parameters.set_interval_s
        left = sum(len(units) for _, units in turns_left(run, self.name, first))
        least_s = left * FULL_TURN_DEG / parameters.turn_rate_deg_per_s
        most_s = _ramp_s(parameters, rate) + parameters.chamber_at_most_s + 2.0 * interval_s
        sets = max(sets_of_ramp(parameters, rate, upwards=self.upwards) - first, 1)
        return Duration(min(sets * interval_s, most_s), least_s, most_s)


def make_ramp(run: Run, ramp: Ramp) -> None:
    """Do sets of turns until every gyro has come to its end, the chamber on its way.

    Raises ConditionNotReached where they do not come there on the ramp of the fit.
    """
    if run.is_finished(ramp.end):
        return
    parameters: FogParameters = run.parameters
    bench = run.state(Following, run)
    done = [unit for unit in run.past.finished if unit.split(" ")[0] == ramp.name]
    first = max((int(unit.split(" ")[1]) for unit in done), default=0)
    first += not any(turns_left(run, ramp.name, first))
    run.apply(ramp.command)
    turns, rate = next(full_turns(parameters))[0].text, parameters.turn_rate_deg_per_s
    bounds = Bounds(rate_deg_per_s=rate)
    run.declare(Bounded(NAVIGATOR, turns, within=bounds, decided_by=TURN_RATE))
    if ramp.name == PROOF:
        between = run.read(partial(fitted_degC, run), {})
        inside, at_most_s = partial(is_inside, bench, between), parameters.chamber_at_most_s
        bench.follow_until(inside, 0.0, at_most_s, PROOF, bench.how_warm)
    began_s, ended = run.now_s, end_of(run, ramp, bench)
    for number in run.repeats(count(first), ramp.takes(run, first)):
        run.may_pause()
        begins_s = began_s + (number - first) * parameters.set_interval_s
        bench.follow(begins_s, ramp.name, bench.how_warm())
        one_set(run, ramp.name, number)
        if run.read(ended, assumed=True):
            break
    run.finish(ramp.end)


def end_of(run: Run, ramp: Ramp, bench: Following) -> Callable[[], bool]:
    """Return what says, after each set, whether every gyro is at its end, or can go no further."""
    parameters: FogParameters = run.parameters
    at_end_s: list[float] = []
    """When the chamber was at its end, first of all."""

    def ended() -> bool:
        gyros = bench.gyro_degC()
        there = gyros >= ramp.gyros_degC if ramp.upwards else gyros <= ramp.gyros_degC
        if there.all():
            return True
        if not bench.chamber.is_ramping():
            at_end_s.append(run.now_s)
        if not at_end_s or run.now_s - at_end_s[0] <= parameters.chamber_at_most_s:
            return False
        if ramp.name == PROOF:
            run.say(f"    the proof ends at {bench.how_warm()}: they go no further")
            return True
        raise ConditionNotReached(
            f"{parameters.chamber_at_most_s / SECONDS_PER_HOUR:.3g} h after the end of the "
            f"ramp {NAVIGATOR} reports the gyros at "
            f"{', '.join(f'{gyro_degC:.1f}' for gyro_degC in gyros)} degC, not at "
            f"{ramp.gyros_degC:g} degC, and {CHAMBER} that its air does at "
            f"{bench.chamber.temperature_degC():.1f} degC; take a range that they reach with "
            "their own heat"
        )

    return ended


def fitted_degC(run: Run) -> dict[str, tuple[float, float]]:
    """Return the lowest and the highest temperature of each gyro's turns of the fit."""
    by_gyro: dict[str, list[float]] = {}
    for unit, details in run.read_back().finished_units().items():
        if unit.split(" ")[0] == RAMP:
            by_gyro.setdefault(details["axis"], []).append(details["stands"]["own_degC"])
    return {axis: (min(values), max(values)) for axis, values in by_gyro.items()}


def is_inside(bench: Following, between: dict[str, tuple[float, float]]) -> bool:
    """Whether no gyro is still warmer, or colder, than in any turn of the fit."""
    gyros = dict(zip(AXES, bench.gyro_degC(), strict=True))
    return all(low <= gyros[axis] <= high for axis, (low, high) in between.items())


def turns_left(run: Run, name: str, number: int) -> Iterator[tuple[str, list[tuple[str, int]]]]:
    """Yield the axes whose turns of a set are not made, each with their units and senses.

    Turns that an interruption took apart have not the same bias: all are made again, as new units.
    """
    signs = run.parameters.signs
    for axis in run.parameters.axes:
        for again in count():
            numbers = range(again * len(signs), (again + 1) * len(signs))
            units = [f"{name} {number} {axis} {k}" for k in numbers]
            made = sum(run.is_finished(unit) for unit in units)
            if not made:
                yield axis, list(zip(units, signs, strict=True))
            if made in (0, len(units)):
                break


def one_set(run: Run, name: str, number: int) -> None:
    """Turn each axis up in turn, and about it; each turn is a unit of work."""
    parameters: FogParameters = run.parameters
    bench = run.state(Following, run)
    for axis, units in turns_left(run, name, number):
        moves = to_up(axis)
        each = on_the_way(parameters.reorientation_s / len(moves))
        bench.go_to(moves, name, f"{axis} is turned up", each)
        for (unit, sign), turn in zip(units, full_turns(parameters), strict=True):
            doing = f"set {number}, {axis}, {bench.how_warm()}"
            commanded_deg = FULL_TURN_DEG * sign
            with run.unit(unit, axis=axis, set=number, commanded_deg=commanded_deg) as details:
                details |= turn_around(run, turn, unit, doing)
                details |= run.read(partial(stands, bench, axis), {})
            bench.follow(run.now_s + parameters.pause_s, name, doing)


def turn_around(
    run: Run, turn: tuple[AxisAtRate, AxisBy], unit: str, doing: str
) -> dict[str, float]:
    """Turn the vertical axis once at the plan's rate, at rest before and after.

    Returns the run times of the end of the first rest and of both ends of the second, and the angle
    that the encoder turned.
    """
    bench, (at_rate, by_angle) = run.state(Following, run), turn
    outer = axis_of(run, by_angle)
    bench.rest(unit, doing)
    before_s = run.now_s
    before_deg = run.prepare(by_angle) or 0.0
    left_deg = run.read(
        lambda: before_deg + by_angle.angle_deg - bench.table.angle_deg(outer), by_angle.angle_deg
    )
    run.apply(at_rate)
    ends_s = run.now_s + abs(left_deg / at_rate.rate_deg_per_s) - SHORT_OF_TURN_S

    def keep_rate() -> None:
        while run.now_s < ends_s:
            bench.follow(min(run.now_s + TURNING_LOOK_S, ends_s), unit, doing)
            bench.table.is_at_rate(outer)  # raises where it does not keep it

    run.read(keep_rate, takes=exactly(run.parameters.schedule.motion_s), rates=bench.rates)
    bench.go_to([by_angle], unit, doing)
    rests_s = run.now_s
    bench.rest(unit, doing)
    after_s = run.now_s
    turned_deg = run.read(lambda: bench.table.angle_deg(outer) - before_deg, by_angle.angle_deg)
    return {"turned_deg": turned_deg, "before_s": before_s, "rests_s": rests_s, "after_s": after_s}


def stands(bench: Following, axis: str) -> dict[str, Any]:
    """Return how warm gyros and chamber are after a turn: where a resumed run goes back to."""
    gyros = bench.gyro_degC()
    where = {
        "gyro_degC": float(gyros.mean()),
        "own_degC": float(gyros[AXES.index(axis)]),
        "set_point_degC": bench.chamber.set_point_degC(),
    }
    return {"chamber_degC": bench.chamber.temperature_degC(), "stands": where}


def to_up(axis: str) -> tuple[AxisTo, ...]:
    """Return the moves that let a body axis point up."""
    middle_deg, inner_deg = UP[axis]
    text = f"{axis} up: middle and inner axis to {middle_deg:g} deg, {inner_deg:g} deg"
    return moves(text, middle=middle_deg, inner=inner_deg)


def moves(text: str, **angles_deg: float) -> tuple[AxisTo, ...]:
    """Return the commands that bring axes of the table, by name, to angles."""
    return tuple(
        AxisTo(TABLE, axis, text, angle_deg=angle_deg, decided_by=TURN_RATE)
        for axis, angle_deg in angles_deg.items()
    )


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


def sets_of_ramp(parameters: FogParameters, rate_degC_per_h: float, *, upwards: bool = True) -> int:
    """Return how many sets of turns a ramp is expected to hold."""
    lag_degC = rate_degC_per_h / SECONDS_PER_HOUR * EXPECTED_LAG_S
    behind_degC = lag_degC * -math.expm1(-parameters.span_degC / lag_degC)
    after_s = nearing_s(behind_degC, EXPECTED_HEAT_DEGC if upwards else near_degC(parameters))
    lasts_s = _ramp_s(parameters, rate_degC_per_h) + after_s
    return math.ceil(lasts_s / parameters.set_interval_s - 1e-9) + 1


def _ramp_s(parameters: FogParameters, rate_degC_per_h: float) -> float:
    return parameters.span_degC / rate_degC_per_h * SECONDS_PER_HOUR


def nearing_s(from_degC: float, to_degC: float) -> float:
    """Return the time in which the gyros come from one distance to another, nearer one."""
    return EXPECTED_LAG_S * math.log(max(from_degC / to_degC, 1.0))


def left_degC(parameters: FogParameters) -> float:
    """Return how much warmer the gyros would still become when they count as warm."""
    slope_degC_per_s = parameters.warm_up.slope_limit_degC_per_h / SECONDS_PER_HOUR
    return min(slope_degC_per_s * EXPECTED_LAG_S, EXPECTED_HEAT_DEGC)


def near_degC(parameters: FogParameters) -> float:
    """Return how far the gyros may be from where they would come to rest where a proof is cold."""
    return max(PROVED_WITHIN_DEGC - left_degC(parameters), MIN_LEFT_DEGC)
