"""One unit of work: turn to an angle, set a field, let both settle, read the output."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from procedures.common.stage_and_meter import AtStage, record_angle, record_output
from procedures.common.stage_and_meter import turn_to as turn_stage_to
from station.errors import ConditionNotReached, InstrumentError
from station.method.commands import SteadyField
from station.method.duration import Duration, exactly, on_the_way
from station.method.run import Run
from station.method.verbs import keep
from station.roles import Gaussmeter

from .parameters import AccelerometerParameters, Point

SUPPLY = "coil_supply.dc"
GAUSSMETER = "gaussmeter"
LARGEST_FIELD = ("parameters", "largest_field")
ANGLES = ("parameters", "angles")
FULL_TURN_DEG = 360.0
T_PER_MT = 1e-3
AXIS_COLUMN = "x_T"
"""The probe's x stands along the coil's axis."""
FIELD_LOOK_S = 0.5
RAMP_S = 0.4
RAMP_MT_PER_S = 25.0
"""A supply of 5 A/s at a coil of 5 mT/A."""


@dataclass
class Following:
    """What a gaussmeter read at the last point: every reading has noise, and a field changes it."""

    commanded_mT: float = math.nan
    measured_mT: float = math.nan

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
    field_mT: float = 0.0
    rms_mT: float = 0.0
    followed: Following = field(default_factory=Following)


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
        "range_V": run.state(AtStage).range_V,
    }
    with run.unit(point.unit, **details):
        record_angle(run, point.unit, point.angle_deg)
        gaussmeter = run.role(GAUSSMETER, Gaussmeter)

        def keep_field() -> None:
            keep(run, point.unit, gaussmeter, gaussmeter.drain())

        record_output(
            run, point.unit, doing, gaussmeter.drain, keep_field, rates={GAUSSMETER: None}
        )


def turn_to(run: Run, point: Point, doing: str) -> None:
    """Turn the stage to a point's angle."""
    turn_stage_to(run, point.angle_deg, point.plane, doing, ANGLES)


def settle(run: Run, point: Point, doing: str) -> None:
    """Wait until successive readings of the field agree; the plan's dwell rule says for how long.

    Raises ConditionNotReached when they never do, InstrumentError when the field did not follow.
    """
    rule = run.parameters.dwell
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)

    def act() -> None:
        measured_mT = settled_mT(run, gaussmeter, doing)
        followed = run.state(BenchState).followed
        followed.driven(GAUSSMETER, point.field_mT, measured_mT, rule.field_change_mT)

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
