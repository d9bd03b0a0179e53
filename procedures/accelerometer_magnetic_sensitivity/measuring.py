"""One unit of work: turn to an angle, set a field, let both settle, read the output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from station.errors import ConditionNotReached, InstrumentError

from .check import GAUSSMETER, MULTIMETER, STAGE, SUPPLY, THERMOMETER
from .parameters import AccelerometerParameters, Point
from .standing_still import StandingStill

if TYPE_CHECKING:
    from station.runner.run import Run

T_PER_MT = 1e-3
LOOK_S = 0.25
FIELD_LOOK_S = 0.5
LONGEST_LOOK_S = 2.0
AXIS_COLUMN = "x_T"
"""The probe's x stands along the coil's axis."""
RANGE_HEADROOM = 1.5
HIGHER_RANGE = 10.0
MOST_RANGES = 3
BURST_PATIENCE = 3.0
LEAST_PATIENCE_S = 10.0
STAGE_COLUMNS = {
    "angle_deg": "deg, the stage's encoder, at rest",
    "desired_deg": "deg, the angle that was commanded",
}


@dataclass
class Place:
    """Where the bench stands: what the next point need not set again."""

    plane: str | None = None
    angle_deg: float = math.nan
    range_V: float = 0.0
    meters: StandingStill = field(default_factory=StandingStill)


def measure(run: Run, point: Point, place: Place, said: str) -> None:
    """Measure one (plane, angle, field) point; one that an earlier process finished stays.

    `said` is how far the plan is, for the operator. Raises ConditionNotReached when the field does
    not settle, InstrumentError when an instrument fails.
    """
    from station.roles import DirectCurrentSupply

    if run.is_finished(point.unit):
        return
    run.may_pause()
    turn_to(run, point.angle_deg, place, said)
    supply = run.role(SUPPLY, DirectCurrentSupply)
    supply.ramp_to(point.field_mT / supply.coil_constant_mT_per_A)
    measured_mT = settle(run, run.parameters, said)
    least_mT = run.parameters.dwell.field_change_mT
    place.meters.driven(GAUSSMETER, point.field_mT, measured_mT, least_mT)
    details = {
        "plane": point.plane,
        "angle_deg": point.angle_deg,
        "field_mT": point.field_mT,
        "number": point.number,
        "range_V": place.range_V,
    }
    with run.unit(point.unit, **details):
        record_angle(run, point)
        for _ in range(MOST_RANGES):
            if not read_output(run, point.unit, said, place.meters):
                return
            widen(run, point.unit, place)
        raise InstrumentError(
            MULTIMETER,
            f"measured {point.unit}",
            f"it was overloaded in every range up to {place.range_V:g} V",
            "look at the accelerometer's output and its load resistor",
        )


def turn_to(run: Run, angle_deg: float, place: Place, said: str) -> None:
    """Turn the stage to an angle and wait until it rests there; nothing moves where it does."""
    from station.roles import RotaryStage

    if place.angle_deg == angle_deg:
        return
    stage = run.role(STAGE, RotaryStage)
    stage.move_to(angle_deg)
    wait_for_stage(run, f"{said}, turning to {angle_deg:g} deg")
    place.angle_deg = angle_deg


def wait_for_stage(run: Run, said: str) -> None:
    """Wait until the stage rests; the driver raises InstrumentError when it never does."""
    from station.roles import RotaryStage

    stage = run.role(STAGE, RotaryStage)
    while stage.is_moving():
        run.clock.sleep(LOOK_S)
        run.say_progress(said)


def settle(run: Run, parameters: AccelerometerParameters, said: str) -> float:
    """Wait until successive readings of the field agree; the plan's dwell rule says for how long.

    Returns the last reading in mT. Raises ConditionNotReached when they never do.
    """
    from station.roles import Gaussmeter

    rule = parameters.dwell
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    gaussmeter.drain()
    began_s = run.clock.now()
    until_s = began_s + run.clock.patience_s(rule.at_most_s)
    steady_since_s, before_mT = began_s, math.nan
    while True:
        run.clock.sleep(FIELD_LOOK_S)
        rows = gaussmeter.drain()
        now_s = run.clock.now()
        for field_T in rows.columns[AXIS_COLUMN]:
            field_mT = float(field_T) / T_PER_MT
            if not abs(field_mT - before_mT) <= rule.field_change_mT:
                steady_since_s = now_s
            before_mT = field_mT
        run.say_progress(f"{said}, {before_mT:.3f} mT")
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
    import numpy as np

    from station.record.raw import ARRIVAL
    from station.roles import RotaryStage

    angle_deg = run.role(STAGE, RotaryStage).angle_deg()
    names = [(name, np.float64) for name in (*STAGE_COLUMNS, ARRIVAL)]
    row = np.array([(angle_deg, point.angle_deg, run.clock.now())], dtype=names)
    run.record.block(STAGE, point.unit, STAGE_COLUMNS, row)


def read_output(run: Run, unit: str, said: str, meters: StandingStill) -> bool:
    """Record a burst of the voltmeter, temperature and field beside it; True when overloaded."""
    from station.roles import Gaussmeter, Multimeter, Thermometer

    parameters: AccelerometerParameters = run.parameters
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    bursts: dict[str, Any] = {MULTIMETER: run.role(MULTIMETER, Multimeter)}
    gaussmeter.drain()
    bursts[MULTIMETER].start(parameters.readings)
    if parameters.temperature:
        bursts[THERMOMETER] = run.role(THERMOMETER, Thermometer)
        bursts[THERMOMETER].start(1)
    overloaded = False
    expected_s = run.clock.now() + burst_s(parameters)
    longest_s = (BURST_PATIENCE - 1.0) * burst_s(parameters) + LEAST_PATIENCE_S
    until_s = expected_s + run.clock.patience_s(longest_s)
    while bursts:
        left_s = expected_s - run.clock.now()
        if left_s > 0:  # no meter has anything to give yet; the field goes on coming
            run.clock.sleep(min(left_s, LONGEST_LOOK_S))
            keep(run, gaussmeter, unit, gaussmeter.drain())
            run.say_progress(said)
            continue
        run.clock.sleep(LOOK_S)
        fetched = {name: source.fetch() for name, source in bursts.items()}
        for name, block in fetched.items():
            if block is None:
                continue
            source = bursts.pop(name)
            keep(run, source, unit, block)
            if name == MULTIMETER:
                overloaded = bool(block.columns["overload"].any())
                if not overloaded:
                    meters.output(name, unit, {float(one) for one in block.columns["voltage_V"]})
        keep(run, gaussmeter, unit, gaussmeter.drain())
        run.say_progress(said)
        if bursts and run.clock.now() > until_s:
            raise InstrumentError(
                min(bursts),
                f"record {unit}",
                "its readings never came",
                "look at its display: it may wait for a trigger that nobody gives",
            )
    return overloaded


def keep(run: Run, source: Any, unit: str, block: Any) -> None:
    """Record a block of rows where there are any."""
    from station.runner.verbs import to_rows

    if len(block):
        run.record.block(source.source, unit, source.columns, to_rows(block))


def widen(run: Run, unit: str, place: Place) -> None:
    """Take the next higher range after an overload; the point is then measured again."""
    from station.roles import Multimeter

    before_V = place.range_V
    meter = run.role(MULTIMETER, Multimeter)
    place.range_V = meter.configure(HIGHER_RANGE * before_V, run.parameters.nplc)
    run.record.event("overload", unit=unit, range_V=before_V, next_range_V=place.range_V)
    run.progress.say(f"    {unit}: overload, measured again in the {place.range_V:g} V range")


def burst_s(parameters: AccelerometerParameters) -> float:
    """Return the bench time in s of one burst: auto-zero doubles the integration time."""
    return 2.0 * parameters.readings * parameters.nplc / 50.0


def group_by_angle(points: tuple[Point, ...]) -> list[list[Point]]:
    """Return the points in their order, in groups without a turn of the stage between them."""
    groups: list[list[Point]] = []
    for point in points:
        same = groups and (groups[-1][0].plane, groups[-1][0].angle_deg) == (
            point.plane,
            point.angle_deg,
        )
        if same:
            groups[-1].append(point)
        else:
            groups.append([point])
    return groups


def finished_points(units: Mapping[str, Any], points: tuple[Point, ...]) -> list[Point]:
    """Return the points that are finished, in the plan's order."""
    return [point for point in points if point.unit in units]
