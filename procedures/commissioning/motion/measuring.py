"""One unit of work of the table's part: a turn there and back between rests, or a level."""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.errors import ConditionNotReached
from station.method.verbs import Follower, keep_row
from station.roles import Imu, Navigator, Turntable

from .parameters import MotionParameters, TableTurn
from .placing import go_to
from .work import IMU, TURNTABLE, begin_of, spin

if TYPE_CHECKING:
    from station.method.run import Run

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


class Sensing:
    """The sensor's stream for one unit of work."""

    def __init__(self, run: Run, unit: str) -> None:
        self._run, self._unit = run, unit
        parameters: MotionParameters = run.parameters.motion
        device = parameters.device
        self._sensor: Imu | Navigator = (
            run.role(device, Imu) if device == IMU else run.role(device, Navigator)
        )
        self._sensor.start(parameters.sample_rate_Hz)
        self._follower = Follower(run, {device: self._sensor})

    def follow(self, seconds: float) -> None:
        """Record for a time."""
        self._follower.follow(self._run.clock.now() + seconds, self._unit, self._unit, LOOK_S)

    def stop(self) -> None:
        """End the output and record the rest of it."""
        self._sensor.stop()
        self._follower.take(self._unit)


def record_level(run: Run, unit: str) -> None:
    """Record the sensor at rest."""
    parameters: MotionParameters = run.parameters.motion
    with run.unit(unit):
        sensing = Sensing(run, unit)
        sensing.follow(parameters.rest_s)
        sensing.stop()


def record_turn(run: Run, turn: TableTurn) -> None:
    """Record a turn: rest, there, rest, back, rest. Its event holds the run times between them."""
    parameters: MotionParameters = run.parameters.motion
    go_to(run, begin_of(turn))
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
    sensing.follow(seconds)


def go(run: Run, turn: TableTurn, sense: int, sensing: Sensing) -> None:
    """Turn in one sense until the encoder has the turn's angle, or zero again; then come to rest.

    Raises ConditionNotReached where it takes far longer than it should.
    """
    command = spin(turn, sense)
    number = command.axis_number(run.bench)
    table = run.role(TURNTABLE, Turntable)
    began_s, rate = run.now_s, abs(command.rate_deg_per_s)
    gives_up_s = began_s + LATE * turn.angle_deg / rate + LATE_S
    end_deg = turn.angle_deg if sense > 0 else 0.0
    run.apply(command)
    left_deg = sense * (end_deg - table.angle_deg(number))
    while left_deg > 0.0:
        sensing.follow(min(LOOK_S, max(left_deg / rate, LOOK_S / 5.0)))
        if table.is_at_rate(number):
            read(run, turn, command.rate_deg_per_s, AT_RATE)
        left_deg = sense * (end_deg - table.angle_deg(number))
        if run.now_s > gives_up_s:
            raise ConditionNotReached(
                f"the {turn.axis} axis of {TURNTABLE} has {left_deg:.2f} deg of {turn.unit} left "
                f"after {run.now_s - began_s:.0f} s at {rate:g} deg/s; look whether "
                "something holds it"
            )
    table.stop(number)
    while table.is_moving(number):
        sensing.follow(LOOK_S)


def read(run: Run, turn: TableTurn, commanded_deg_per_s: float, at_rate: float) -> None:
    """Record what encoder and rate read back."""
    table = run.role(TURNTABLE, Turntable)
    number = spin(turn, +1).axis_number(run.bench)
    angle_deg, rate = table.angle_deg(number), table.rate_deg_per_s(number)
    keep_row(
        run, turn.unit, TURNTABLE, TABLE_COLUMNS, angle_deg, rate, commanded_deg_per_s, at_rate
    )
