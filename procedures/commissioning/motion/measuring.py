"""One unit of work of the table's part: a turn there and back between rests, or a level."""

from __future__ import annotations

from functools import partial

from station.errors import ConditionNotReached
from station.method.duration import exactly, on_the_way
from station.method.motion import AxisAtRate, AxisTo
from station.method.run import Run
from station.method.set_points import Bounded, Bounds
from station.method.verbs import Recording, axis_of, keep_row
from station.roles import Imu, Navigator, Turntable

from .parameters import MotionParameters, TableTurn
from .placing import IMU, MOTION, TURNTABLE, go_to, moves

OVERSHOOT_DEG, SETTLING_S = 20.0, 3.0
"""An axis is stopped at the first reading beyond its angle, and brakes from there."""
LOOK_S = 0.5
LATE, LATE_S = 1.5, 10.0
"""A turn that takes so many times longer, and so many seconds more, is held by something."""
REST, AT_RATE = 0.0, 1.0
TABLE_COLUMNS = {
    "angle_deg": "deg, the encoder of the axis that turns, turns counted",
    "rate_deg_per_s": "deg/s, read back",
    "commanded_deg_per_s": "deg/s, set-point",
    "at_rate": "1, 1 while the controller says that the axis has its rate, 0 at rest",
}


def begin_of(turn: TableTurn) -> tuple[AxisTo, ...]:
    """Return the commands that bring the table where a turn begins."""
    return moves((0.0, turn.middle_deg, 0.0), f"{turn.unit}: where it begins")


def spin(turn: TableTurn, sense: int) -> AxisAtRate:
    """Return the command of a turn in one sense."""
    rate = sense * turn.rate_deg_per_s
    return AxisAtRate(TURNTABLE, turn.axis, turn.unit, None, rate, decided_by=MOTION)


class Sensing(Recording):
    """The sensor's stream for one unit of work."""

    def __init__(self, run: Run, unit: str) -> None:
        parameters: MotionParameters = run.parameters.motion
        device = parameters.device
        self._sensor: Imu | Navigator = (
            run.role(device, Imu) if device == IMU else run.role(device, Navigator)
        )
        self._sensor.start(parameters.sample_rate_Hz)
        super().__init__(run, unit, {device: parameters.sample_rate_Hz})

    def rest(self, seconds: float) -> None:
        """Record for a time."""
        self.follow(seconds, self.unit, every_s=LOOK_S)

    def stop(self) -> None:
        """End the output and record the rest of it."""
        self._sensor.stop()
        self._run.read(self.take)


def record_level(run: Run, unit: str) -> None:
    """Record the sensor at rest."""
    parameters: MotionParameters = run.parameters.motion
    with run.unit(unit):
        sensing = Sensing(run, unit)
        sensing.rest(parameters.rest_s)
        sensing.stop()


def record_turn(run: Run, turn: TableTurn) -> None:
    """Record a turn: rest, there, rest, back, rest. Its event holds the run times between them."""
    parameters: MotionParameters = run.parameters.motion
    go_to(run, begin_of(turn))
    text = f"{turn.unit} by {turn.angle_deg:g} deg"
    for angle_deg in (-OVERSHOOT_DEG, turn.angle_deg + OVERSHOOT_DEG):
        within: Bounds = {"angle_deg": angle_deg}
        run.declare(Bounded(TURNTABLE, text, within=within, decided_by=MOTION))
    with run.unit(turn.unit) as facts:
        sensing = Sensing(run, turn.unit)
        marks_s = [run.now_s]
        rest(run, turn, sensing, parameters.rest_s)
        for sense in (+1, -1):
            marks_s.append(run.now_s)
            go(run, turn, sense, sensing)
            marks_s.append(run.now_s)
            rest(run, turn, sensing, parameters.rest_s)
        marks_s.append(run.now_s)
        sensing.stop()
        facts.update(marks_s=marks_s)


def rest(run: Run, turn: TableTurn, sensing: Sensing, seconds: float) -> None:
    """Record at rest, and the encoder once."""
    read(run, turn, 0.0, REST)
    sensing.rest(seconds)


def go(run: Run, turn: TableTurn, sense: int, sensing: Sensing) -> None:
    """Turn in one sense until the encoder has the turn's angle, or zero again; then come to rest.

    Raises ConditionNotReached where it takes far longer than it should.
    """
    command = spin(turn, sense)
    axis, table = axis_of(run, command), run.role(TURNTABLE, Turntable)
    run.apply(command)
    takes = exactly(turn.angle_deg / turn.rate_deg_per_s) + on_the_way(SETTLING_S)
    rates = {**sensing.rates, TURNTABLE: 1.0 / LOOK_S}
    run.read(partial(turn_over, run, turn, sense, sensing, table, axis), takes=takes, rates=rates)


def turn_over(
    run: Run, turn: TableTurn, sense: int, sensing: Sensing, table: Turntable, axis: int
) -> None:
    """Record until an axis that turns has its angle, stop it and wait until it rests."""
    began_s, rate = run.now_s, turn.rate_deg_per_s
    gives_up_s = began_s + LATE * turn.angle_deg / rate + LATE_S
    end_deg = turn.angle_deg if sense > 0 else 0.0
    left_deg = sense * (end_deg - table.angle_deg(axis))
    while left_deg > 0.0:
        sensing.rest(min(LOOK_S, max(left_deg / rate, LOOK_S / 5.0)))
        if table.is_at_rate(axis):
            read(run, turn, sense * rate, AT_RATE)
        left_deg = sense * (end_deg - table.angle_deg(axis))
        if run.now_s > gives_up_s:
            raise ConditionNotReached(
                f"the {turn.axis} axis of {TURNTABLE} has {left_deg:.2f} deg of {turn.unit} left "
                f"after {run.now_s - began_s:.0f} s at {rate:g} deg/s; look whether "
                "something holds it"
            )
    table.stop(axis)
    while table.is_moving(axis):
        sensing.rest(LOOK_S)


def read(run: Run, turn: TableTurn, commanded_deg_per_s: float, at_rate: float) -> None:
    """Record what encoder and rate read back."""
    table, axis = run.role(TURNTABLE, Turntable), axis_of(run, spin(turn, +1))
    read_back = table.angle_deg(axis), table.rate_deg_per_s(axis)
    keep_row(run, turn.unit, TURNTABLE, TABLE_COLUMNS, *read_back, commanded_deg_per_s, at_rate)
