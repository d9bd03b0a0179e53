"""Ramps of the chamber with sets of turns: of the fit and of the proof; a ramp may be resumed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached
from station.method.motion import TemperatureRamp

from .bench_work import COOLING, PROOF, RAMP, BenchWork
from .parameters import AXES, SECONDS_PER_HOUR, FogParameters
from .work import CHAMBER, NAVIGATOR, PROVED_WITHIN_DEGC, full_turns, to_temperature, to_up

if TYPE_CHECKING:
    from station.method.run import Run

DRIFTED_DEGC = 1.0


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


def is_turn(unit: str) -> bool:
    """Whether a unit of work is a turn of a ramp."""
    return unit.split(" ")[0] in (RAMP, PROOF)


def last_turn(run: Run) -> dict[str, float] | None:
    """Return where the ramp stood at the last turn of an earlier process, None without one."""
    turns = [details for unit, details in run.past.finished.items() if is_turn(unit)]
    return dict(turns[-1]["stands"]) if turns else None


def soak_again(run: Run, stood: dict[str, float]) -> None:
    """Bring gyros and chamber to where they were when the run was interrupted."""
    work = run.state(BenchWork, run)
    wanted_degC = stood["gyro_degC"]
    run.say(f"    the gyros go back to {wanted_degC:.1f} degC")

    def there() -> bool:
        return bool(abs(work.gyro_degC().mean() - wanted_degC) <= DRIFTED_DEGC)

    limit_s = run.parameters.warm_up.at_most_s
    if not work.follow_until(there, limit_s, COOLING, lambda: said_of(work)):
        run.say("    they do not come there: the ramp goes on from where they are")
    # A controller rounds what it reads back: at an end of the range it may lie a digit beyond.
    low_degC, high_degC = run.parameters.temperature_range_degC
    set_degC = min(max(stood["set_point_degC"], low_degC), high_degC)
    work.reach(to_temperature(set_degC, "back to where the ramp stood"), COOLING)


def make_ramp(run: Run, ramp: Ramp) -> None:
    """Do sets of turns until every gyro has come to its end, the chamber on its way.

    Raises ConditionNotReached where they do not come there on the ramp of the fit.
    """
    if run.is_finished(ramp.end):
        return
    parameters: FogParameters = run.parameters
    work = run.state(BenchWork, run)
    done = [unit for unit in run.past.finished if unit.split(" ")[0] == ramp.name]
    first = max((int(unit.split(" ")[1]) for unit in done), default=0)
    first += not any(turns_left(run, ramp.name, first))
    run.apply(ramp.command)
    if ramp.name == PROOF:
        between = fitted_degC(run)
        work.follow_until(
            lambda: is_inside(work, between),
            parameters.chamber_at_most_s,
            PROOF,
            lambda: said_of(work),
        )
    began_s = run.now_s
    number, ended_s = first, math.inf
    while True:
        run.may_pause()
        work.follow(
            began_s + (number - first) * parameters.set_interval_s, ramp.name, said_of(work)
        )
        one_set(run, ramp.name, number)
        number += 1
        gyros = work.gyro_degC()
        there = gyros >= ramp.gyros_degC if ramp.upwards else gyros <= ramp.gyros_degC
        if there.all():
            break
        if not work.chamber.is_ramping():
            ended_s = min(ended_s, run.now_s)
        if run.now_s - ended_s > parameters.chamber_at_most_s:
            if ramp.name == PROOF:
                run.say(f"    the proof ends at {said_of(work)}: they go no further")
                break
            raise ConditionNotReached(
                f"{parameters.chamber_at_most_s / SECONDS_PER_HOUR:.3g} h after the end of the "
                f"ramp {NAVIGATOR} reports the gyros at "
                f"{', '.join(f'{gyro_degC:.1f}' for gyro_degC in gyros)} degC, not at "
                f"{ramp.gyros_degC:g} degC, and {CHAMBER} that its air does at "
                f"{work.chamber.temperature_degC():.1f} degC; take a range that they reach with "
                "their own heat"
            )
    run.finish(ramp.end)


def fitted_degC(run: Run) -> dict[str, tuple[float, float]]:
    """Return the lowest and the highest temperature of each gyro's turns of the fit."""
    by_gyro: dict[str, list[float]] = {}
    for unit, details in run.read_back().finished_units().items():
        if unit.split(" ")[0] == RAMP:
            by_gyro.setdefault(details["axis"], []).append(details["stands"]["own_degC"])
    return {axis: (min(values), max(values)) for axis, values in by_gyro.items()}


def is_inside(work: BenchWork, between: dict[str, tuple[float, float]]) -> bool:
    """Whether no gyro is still warmer, or colder, than in any turn of the fit."""
    gyros = dict(zip(AXES, work.gyro_degC(), strict=True))
    return all(low <= gyros[axis] <= high for axis, (low, high) in between.items())


def coldest_degC(run: Run) -> float:
    """Return how cold, in the mean, the gyros have to become in a proof."""
    units = run.read_back().finished_units()
    first = next(details for unit, details in units.items() if unit.split(" ")[0] == RAMP)
    return float(first["stands"]["gyro_degC"]) + PROVED_WITHIN_DEGC


def cool_down(run: Run, chamber_degC: float, gyros_degC: float) -> None:
    """Let the gyros become cold again, as far as they do within the plan's time."""
    work = run.state(BenchWork, run)
    work.reach(to_temperature(chamber_degC, "the gyros cool down"), COOLING)
    work.follow_until(
        lambda: bool((work.gyro_degC() <= gyros_degC).all()),
        run.parameters.chamber_at_most_s,
        COOLING,
        lambda: said_of(work),
    )


def said_of(work: BenchWork) -> str:
    """Return how warm it is, for the operator."""
    return f"gyros {work.gyro_degC().mean():.1f} degC"


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
    """Turn about each axis in turn; each turn is a unit of work."""
    parameters: FogParameters = run.parameters
    work = run.state(BenchWork, run)
    for axis, units in turns_left(run, name, number):
        work.go_to(to_up(axis), name, f"{axis} is turned up")
        for (unit, sign), turn in zip(units, full_turns(parameters), strict=True):
            run.event("unit-started", durable=False, unit=unit)
            doing = f"set {number}, {axis}, {said_of(work)}"
            before_s, rests_s, after_s, turned_deg = work.turn_around(turn, unit, doing)
            stands = {
                "gyro_degC": float(work.gyro_degC().mean()),
                "own_degC": float(work.gyro_degC()[AXES.index(axis)]),
                "set_point_degC": work.chamber.set_point_degC(),
            }
            run.finish(
                unit,
                axis=axis,
                set=number,
                commanded_deg=360.0 * sign,
                turned_deg=turned_deg,
                before_s=before_s,
                rests_s=rests_s,
                after_s=after_s,
                chamber_degC=work.chamber.temperature_degC(),
                stands=stands,
            )
            work.follow(run.now_s + parameters.pause_s, name, doing)
