"""One unit of work: turn to an angle, set a field, let both settle, read the output."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from station.errors import ConditionNotReached, InstrumentError
from station.method.commands import Angle, MeterRange, SteadyField
from station.method.duration import Duration, exactly, on_the_way
from station.method.run import Run
from station.method.verbs import come_to_rest, fetch_bursts, keep, keep_row
from station.roles import Gaussmeter, Multimeter, RotaryStage, Thermometer

from .parameters import AccelerometerParameters, Point

SUPPLY = "coil_supply.dc"
GAUSSMETER = "gaussmeter"
MULTIMETER = "multimeter"
THERMOMETER = "thermometer"
USUAL_DEGC = 20.0
"""Where the record of the thermometer is asked how well it reads."""
STAGE = "rotary_stage"
POWER = "dut_power"
LARGEST_FIELD = ("parameters", "largest_field")
ANGLES = ("parameters", "angles")
LARGEST_G = 1.1
"""What the voltmeter's first range must hold, in the scale factor's units of 1 g."""
MAX_RANGES, HIGHER_RANGE = 3, 10.0
FULL_TURN_DEG = 360.0
T_PER_MT = 1e-3
AXIS_COLUMN = "x_T"
"""The probe's x stands along the coil's axis."""
LOOK_S, FIELD_LOOK_S, MAX_LOOK_S = 0.25, 0.5, 2.0
TURN_S, RAMP_S = 0.75, 0.4
RAMP_MT_PER_S, TURN_DEG_PER_S = 25.0, 20.0
"""A supply of 5 A/s at a coil of 5 mT/A; a stage of the usual rate."""
STAGE_COLUMNS = {
    "angle_deg": "deg, the stage's encoder, at rest",
    "desired_deg": "deg, the angle that was commanded",
}


SAME_POINTS = 3
"""So many points in a row may not read the same."""


@dataclass
class StandingStill:
    """What a voltmeter and a gaussmeter read at the last points.

    Angle or field change from each point to the next, and every reading has noise: one that is the
    same to the last digit over several points is no measurement, and its fit would look perfect.
    """

    outputs_V: list[set[float]] = field(default_factory=list)
    commanded_mT: float = math.nan
    measured_mT: float = math.nan

    def output(self, instrument: str, unit: str, readings_V: set[float]) -> None:
        """Take the readings of a point; raises InstrumentError where three points read the same."""
        self.outputs_V = [*self.outputs_V[1 - SAME_POINTS :], readings_V]
        if len(self.outputs_V) == SAME_POINTS and len(set().union(*self.outputs_V)) == 1:
            raise InstrumentError(
                instrument,
                f"measured {unit}",
                f"it reads {min(readings_V):.9g} V to the last digit for {SAME_POINTS} points",
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
class BenchState:
    """Where the bench stands: what the next point need not set again.

    `rms_mT` is the field whose current heats the coil: it takes many minutes to warm.
    """

    plane: str | None = None
    angle_deg: float | None = None
    field_mT: float = 0.0
    rms_mT: float = 0.0
    range_V: float = 0.0
    meters: StandingStill = field(default_factory=StandingStill)


def measure(run: Run, point: Point, doing: str) -> None:
    """Measure one (plane, angle, field) point; `doing` is how far the plan is, for the operator.

    Raises ConditionNotReached when the field does not settle, InstrumentError when an instrument
    fails.
    """
    turn_to(run, point, doing)
    drive(run, point.field_mT)
    settle(run, point, doing)
    details = {
        "plane": point.plane,
        "angle_deg": point.angle_deg,
        "field_mT": point.field_mT,
        "number": point.number,
        "range_V": run.state(BenchState).range_V,
    }
    with run.unit(point.unit, **details):
        angle_deg = run.role(STAGE, RotaryStage).angle_deg()
        keep_row(run, point.unit, STAGE, STAGE_COLUMNS, angle_deg, point.angle_deg)
        record_output(run, point.unit, doing)


def turn_to(run: Run, point: Point, doing: str) -> None:
    """Turn the stage to a point's angle and wait until it rests; nothing moves where it does."""
    place = run.state(BenchState)
    if place.angle_deg == point.angle_deg:
        return
    way_deg = abs(point.angle_deg - (place.angle_deg or 0.0))
    takes = on_the_way(TURN_S + way_deg / TURN_DEG_PER_S if way_deg else 0.0)
    run.apply(Angle(STAGE, point.angle_deg, point.plane, decided_by=ANGLES))
    come_to_rest(run, STAGE, f"{doing}, turning to {point.angle_deg:g} deg", takes=takes)
    place.angle_deg = point.angle_deg


def settle(run: Run, point: Point, doing: str) -> None:
    """Wait until successive readings of the field agree; the plan's dwell rule says for how long.

    Raises ConditionNotReached when they never do, InstrumentError when the field did not follow.
    """
    rule = run.parameters.dwell
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)

    def act() -> None:
        measured_mT = settled_mT(run, gaussmeter, doing)
        meters = run.state(BenchState).meters
        meters.driven(GAUSSMETER, point.field_mT, measured_mT, rule.field_change_mT)

    waits = Duration(FIELD_LOOK_S, 0.0, rule.at_most_s - rule.at_least_s + 2.0 * FIELD_LOOK_S)
    run.read(act, takes=exactly(rule.at_least_s) + waits)


def settled_mT(run: Run, gaussmeter: Gaussmeter, doing: str) -> float:
    """Return the field in mT once it has settled."""
    rule = run.parameters.dwell
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


def record_output(run: Run, unit: str, doing: str) -> None:
    """Record a burst of the voltmeter, temperature and field beside it; wider where overloaded."""
    parameters: AccelerometerParameters = run.parameters
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    bursts: dict[str, Any] = {MULTIMETER: run.role(MULTIMETER, Multimeter)}
    run.count_rows(MULTIMETER, parameters.readings)
    if parameters.temperature:
        bursts[THERMOMETER] = run.role(THERMOMETER, Thermometer)
        run.count_rows(THERMOMETER, 1)
    burst_s = burst_of(parameters)
    again_s = (MAX_RANGES - 1) * burst_s + MAX_RANGES * MAX_LOOK_S
    takes = exactly(burst_s) + Duration(LOOK_S, 0.0, again_s)

    def act() -> None:
        for _ in range(MAX_RANGES):
            if not read_output(run, unit, gaussmeter, bursts, doing):
                return
            widen(run, unit)
        raise InstrumentError(
            MULTIMETER,
            f"measured {unit}",
            f"it was overloaded in every range up to {run.state(BenchState).range_V:g} V",
            "look at the accelerometer's output and its load resistor",
        )

    run.read(act, takes=takes, rates={GAUSSMETER: None})


def burst_of(parameters: AccelerometerParameters) -> float:
    """Return the bench time in s of one burst: auto-zero doubles the integration time."""
    return 2.0 * parameters.readings * parameters.nplc / 50.0


def read_output(
    run: Run, unit: str, gaussmeter: Gaussmeter, bursts: dict[str, Any], doing: str
) -> bool:
    """Record a burst of each meter and the field meanwhile; True when the voltmeter overloaded."""
    parameters: AccelerometerParameters = run.parameters
    gaussmeter.drain()
    bursts[MULTIMETER].start(parameters.readings)
    if parameters.temperature:
        bursts[THERMOMETER].start(1)
    overloaded = False
    for name, block in fetch_bursts(
        run,
        unit,
        bursts,
        lasts_s=burst_of(parameters),
        meanwhile=lambda: keep(run, unit, gaussmeter, gaussmeter.drain()),
        doing=doing,
    ):
        keep(run, unit, bursts[name], block)
        if name == MULTIMETER:
            overloaded = bool(block.columns["overload"].any())
            if not overloaded:
                readings_V = {float(reading_V) for reading_V in block.columns["voltage_V"]}
                run.state(BenchState).meters.output(name, unit, readings_V)
    return overloaded


def widen(run: Run, unit: str) -> None:
    """Take the next higher range after an overload; the point is then measured again."""
    place = run.state(BenchState)
    before_V = place.range_V
    wider = replace(first_range(run.parameters), largest_V=HIGHER_RANGE * before_V)
    place.range_V = run.apply(wider)
    run.event("overload", unit=unit, range_V=before_V, next_range_V=place.range_V)
    run.say(f"    {unit}: overload, measured again in the {place.range_V:g} V range")


def drive(run: Run, field_mT: float) -> None:
    """Bring a field to the device, which heats the coil as the whole plan does."""
    rms_mT = run.state(BenchState).rms_mT
    command = SteadyField(SUPPLY, field_mT, rms_mT, decided_by=LARGEST_FIELD)
    run.apply(command, takes=ramping_to(run, field_mT))


def ramping_to(run: Run, field_mT: float) -> Duration:
    """Return how long the supply takes from the present field to another, which is now present."""
    place = run.state(BenchState)
    way_mT, place.field_mT = abs(field_mT - place.field_mT), field_mT
    return on_the_way(RAMP_S + way_mT / RAMP_MT_PER_S)


def rms_field_mT(parameters: AccelerometerParameters) -> float:
    """Return the effective value of the plan's fields."""
    levels_mT = parameters.field_levels_mT
    return float((sum(level**2 for level in levels_mT) / len(levels_mT)) ** 0.5)


def first_range(parameters: AccelerometerParameters) -> MeterRange:
    """Return how the voltmeter is read until it is overloaded."""
    largest_V = LARGEST_G * parameters.scale_factor_V_per_g
    return MeterRange(MULTIMETER, largest_V, parameters.nplc, parameters.readings)
