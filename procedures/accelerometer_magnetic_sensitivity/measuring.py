"""One unit of work: turn to an angle, set a field, let both settle, read the output.

A meter that answers but measures no more reads the same number from point to point. Angle or field
change from each point to the next, and every reading has noise: a reading that is the same to the
last digit over several points is no measurement, and its fit would look perfect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from station.errors import ConditionNotReached, InstrumentError
from station.method.verbs import come_to_rest, fetch_bursts, keep, keep_row
from station.roles import Gaussmeter, Multimeter, RotaryStage, Thermometer

from .parameters import AccelerometerParameters, Point
from .work import (
    FIELD_LOOK_S,
    GAUSSMETER,
    MAX_RANGES,
    MULTIMETER,
    STAGE,
    THERMOMETER,
    angle_of,
    burst_s,
    field_of,
    first_range,
    rms_field_mT,
)

if TYPE_CHECKING:
    from station.method.run import Run

T_PER_MT = 1e-3
AXIS_COLUMN = "x_T"
"""The probe's x stands along the coil's axis."""
HIGHER_RANGE = 10.0
POINTS = 3
"""So many points in a row may not read the same."""
STAGE_COLUMNS = {
    "angle_deg": "deg, the stage's encoder, at rest",
    "desired_deg": "deg, the angle that was commanded",
}


@dataclass
class StandingStill:
    """What a voltmeter and a gaussmeter read at the last points."""

    outputs_V: list[set[float]] = field(default_factory=list)
    commanded_mT: float = math.nan
    measured_mT: float = math.nan

    def output(self, instrument: str, unit: str, readings_V: set[float]) -> None:
        """Take the readings of a point; raises InstrumentError where three points read the same."""
        self.outputs_V = [*self.outputs_V[1 - POINTS :], readings_V]
        if len(self.outputs_V) == POINTS and len(set().union(*self.outputs_V)) == 1:
            raise InstrumentError(
                instrument,
                f"measured {unit}",
                f"it reads {min(readings_V):.9g} V to the last digit for {POINTS} points",
                "look at its display, its input and what triggers it, then run again",
            )

    def driven(
        self, instrument: str, commanded_mT: float, measured_mT: float, least_mT: float
    ) -> None:
        """Take the field of a point; raises InstrumentError where it did not follow at all.

        `least_mT` is the least change of the commanded field that must show.
        """
        changed = abs(commanded_mT - self.commanded_mT) > least_mT
        if changed and measured_mT == self.measured_mT:
            raise InstrumentError(
                instrument,
                f"looked for a field of {commanded_mT:g} mT",
                f"it reads {measured_mT:.9g} mT as at {self.commanded_mT:g} mT, to the last digit",
                "look at its display and its probe's cable, then run again",
            )
        self.commanded_mT, self.measured_mT = commanded_mT, measured_mT


@dataclass
class Place:
    """Where the bench stands: what the next point need not set again."""

    plane: str | None = None
    angle_deg: float = math.nan
    range_V: float = 0.0
    meters: StandingStill = field(default_factory=StandingStill)


def measure(run: Run, point: Point, doing: str) -> None:
    """Measure one (plane, angle, field) point; one that an earlier process finished stays.

    `doing` is how far the plan is, for the operator. Raises ConditionNotReached when the field does
    not settle, InstrumentError when an instrument fails.
    """
    if run.is_finished(point.unit):
        return
    parameters: AccelerometerParameters = run.parameters
    place = run.state(Place)
    run.may_pause()
    turn_to(run, point, doing)
    run.apply(field_of(point.field_mT, rms_field_mT(parameters)))
    measured_mT = settle(run, parameters, doing)
    place.meters.driven(GAUSSMETER, point.field_mT, measured_mT, parameters.dwell.field_change_mT)
    details = {
        "plane": point.plane,
        "angle_deg": point.angle_deg,
        "field_mT": point.field_mT,
        "number": point.number,
        "range_V": place.range_V,
    }
    with run.unit(point.unit, **details):
        record_angle(run, point)
        for _ in range(MAX_RANGES):
            if not read_output(run, point.unit, doing):
                return
            widen(run, point.unit)
        raise InstrumentError(
            MULTIMETER,
            f"measured {point.unit}",
            f"it was overloaded in every range up to {place.range_V:g} V",
            "look at the accelerometer's output and its load resistor",
        )


def turn_to(run: Run, point: Point, doing: str) -> None:
    """Turn the stage to a point's angle and wait until it rests; nothing moves where it does."""
    place = run.state(Place)
    if place.angle_deg != point.angle_deg:
        run.apply(angle_of(point))
        come_to_rest(run, STAGE, f"{doing}, turning to {point.angle_deg:g} deg")
        place.angle_deg = point.angle_deg


def settle(run: Run, parameters: AccelerometerParameters, doing: str) -> float:
    """Wait until successive readings of the field agree; the plan's dwell rule says for how long.

    Returns the last reading in mT. Raises ConditionNotReached when they never do.
    """
    rule = parameters.dwell
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    gaussmeter.drain()
    began_s = run.now_s
    until_s = began_s + run.clock.patience_s(rule.at_most_s)
    steady_since_s, before_mT = began_s, math.nan
    while True:
        run.clock.sleep(FIELD_LOOK_S)
        rows = gaussmeter.drain()
        now_s = run.now_s
        for field_T in rows.columns[AXIS_COLUMN]:
            field_mT = float(field_T) / T_PER_MT
            if not abs(field_mT - before_mT) <= rule.field_change_mT:
                steady_since_s = now_s
            before_mT = field_mT
        run.say_progress(f"{doing}, {before_mT:.3f} mT")
        if math.isfinite(before_mT) and now_s - steady_since_s >= rule.at_least_s:
            return before_mT
        if now_s > until_s:
            raise ConditionNotReached(
                f"the field did not settle within {rule.at_most_s:g} s: successive readings differ "
                f"by more than {rule.field_change_mT:g} mT, the last was {before_mT:.3f} mT; look "
                "for moving iron and at the supply, or relax dwell.field_change in the plan"
            )


def record_angle(run: Run, point: Point) -> None:
    """Record what the encoder reads at the point."""
    angle_deg = run.role(STAGE, RotaryStage).angle_deg()
    keep_row(run, point.unit, STAGE, STAGE_COLUMNS, angle_deg, point.angle_deg)


def read_output(run: Run, unit: str, doing: str) -> bool:
    """Record a burst of the voltmeter, temperature and field beside it; True when overloaded."""
    parameters: AccelerometerParameters = run.parameters
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    bursts: dict[str, Any] = {MULTIMETER: run.role(MULTIMETER, Multimeter)}
    gaussmeter.drain()
    bursts[MULTIMETER].start(parameters.readings)
    if parameters.temperature:
        bursts[THERMOMETER] = run.role(THERMOMETER, Thermometer)
        bursts[THERMOMETER].start(1)
    overloaded = False
    for name, block in fetch_bursts(
        run,
        unit,
        bursts,
        lasts_s=burst_s(parameters),
        meanwhile=lambda: keep(run, unit, gaussmeter, gaussmeter.drain()),
        doing=doing,
    ):
        keep(run, unit, bursts[name], block)
        if name == MULTIMETER:
            overloaded = bool(block.columns["overload"].any())
            if not overloaded:
                readings_V = {float(reading_V) for reading_V in block.columns["voltage_V"]}
                run.state(Place).meters.output(name, unit, readings_V)
    return overloaded


def widen(run: Run, unit: str) -> None:
    """Take the next higher range after an overload; the point is then measured again."""
    place = run.state(Place)
    before_V = place.range_V
    wider = replace(first_range(run.parameters), largest_V=HIGHER_RANGE * before_V)
    place.range_V = run.apply(wider)
    run.event("overload", unit=unit, range_V=before_V, next_range_V=place.range_V)
    run.say(f"    {unit}: overload, measured again in the {place.range_V:g} V range")


def finished_points(units: Mapping[str, Any], points: tuple[Point, ...]) -> list[Point]:
    """Return the points that are finished, in the plan's order."""
    return [point for point in points if point.unit in units]
