"""How the sensor comes onto the table, and the table to its zeros and angles.

The sensor stands as in a nine-axis calibration: with all axes at zero X points north along the
inner axis, Y west and Z up along the outer one. A positive turn of the outer axis is clockwise
seen from above; one of the inner axis lets what was west go up, one of the middle what was north.
A navigator stands with x north, y east and z down; its axes are reckoned as X, -Y and -Z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import ConditionNotReached
from station.method.commands import Power
from station.method.duration import on_the_way
from station.method.motion import AxisTo
from station.method.run import Run
from station.method.verbs import axis_of, come_to_rest
from station.procedure import Prompt
from station.roles import Navigator, Turntable

from .parameters import AXES, HOME, TURN_DEG, Angles, MotionParameters

TURNTABLE = "turntable"
IMU, NAVIGATOR = "imu", "navigator"
POWER = "dut_power"
ANGLE = (TURNTABLE, "angle", TURN_DEG, "deg")
"""What the table's calibration record states."""
MOTION = ("parameters", "motion")
MOVE_S, HOMING_S = 8.0, 20.0
ALIGNS_S = 300.0
"""What an alignment usually takes."""
LOOK_S, ALIGN_LOOK_S = 0.5, 5.0
THERE_DEG = 0.003
"""An axis in position reads its angle nearer than this."""
MOUNT = {
    IMU: Prompt(
        "mount-table",
        "Mount the nine-axis sensor on the turntable, its X along the inner and its Z along the "
        "outer axis: with all axes at zero X points north, Y west and Z up. Connect its cable "
        "with enough slack for a whole turn of each axis.",
    ),
    NAVIGATOR: Prompt(
        "mount",
        "Mount the navigator on the turntable: with all axes at zero x points north along the "
        "inner axis, y east and z down. Connect its cables with enough slack for a whole turn of "
        "each axis.",
    ),
}
TURN = {
    IMU: Prompt(
        "mount-table-turned",
        "The table stands at its zeros. Turn the sensor on its plate by half a turn about Z, "
        "against the same stops: X points south, Y east and Z up.",
    ),
    NAVIGATOR: Prompt(
        "mount-turned",
        "The table stands at its zeros. Turn the navigator on its plate by half a turn about z, "
        "against the same stops: x points south, y west and z down.",
    ),
}


@dataclass
class TableState:
    """What this process of a run has done: whether the table has its limits and its zeros."""

    is_ready: bool = False


def moves(angles_deg: Angles, text: str) -> tuple[AxisTo, ...]:
    """Return the commands that bring outer, middle and inner axis to angles."""
    return tuple(
        AxisTo(TURNTABLE, axis, text, angle_deg=angle_deg, decided_by=MOTION)
        for axis, angle_deg in zip(AXES, angles_deg, strict=True)
    )


def make_ready(run: Run) -> None:
    """Have the sensor mounted and on, limits in the table, all axes homed and at zero; once."""
    state = run.state(TableState)
    if state.is_ready:
        return
    ask_at_rest(run, MOUNT[run.parameters.motion.device])
    run.apply(Power(POWER, True))
    table = run.role(TURNTABLE, Turntable)
    table.programme_limits()
    to_zero = moves(HOME, "all axes to zero")
    for move in to_zero:
        axis = axis_of(run, move)
        if not run.read(partial(table.is_homed, axis), assumed=True):
            table.home(axis)
            doing = "the table looks for its zeros"
            come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S)
    go_to(run, to_zero, HOMING_S)
    align(run)
    state.is_ready = True


def turn_device(run: Run) -> None:
    """Have the device turned by half a turn on its plate, and the axes at zero after that."""
    ask_at_rest(run, TURN[run.parameters.motion.device])
    go_to(run, moves(HOME, "all axes to zero"), 0.0)
    align(run)


def align(run: Run) -> None:
    """Let a navigator find its attitude."""
    parameters: MotionParameters = run.parameters.motion
    if parameters.device == NAVIGATOR:
        navigator = run.role(NAVIGATOR, Navigator)
        navigator.align(parameters.latitude_deg)
        run.read(partial(await_alignment, run, navigator), takes=on_the_way(ALIGNS_S))


def await_alignment(run: Run, navigator: Navigator) -> None:
    """Wait until a navigator is aligned; ConditionNotReached where it never is."""
    parameters: MotionParameters = run.parameters.motion
    until_s = run.now_s + parameters.align_at_most_s
    while not navigator.status().aligned:
        run.wait(ALIGN_LOOK_S, "the navigator aligns")
        if run.now_s > until_s:
            raise ConditionNotReached(
                f"{NAVIGATOR} was not aligned within {parameters.align_at_most_s / 60.0:g} min; "
                "look at what it reports, and that nothing shakes the table"
            )


def go_to(run: Run, commands: Sequence[AxisTo], takes_s: float = MOVE_S) -> None:
    """Bring axes to angles, each at rest before the next moves; one that is there stays."""
    table = run.role(TURNTABLE, Turntable)
    takes = on_the_way(takes_s / len(commands))
    for command in commands:
        axis = axis_of(run, command)
        if run.read(partial(is_there, table, axis, command), assumed=False):
            continue
        run.apply(command)
        come_to_rest(run, TURNTABLE, command.text, axis=axis, every_s=LOOK_S, takes=takes)


def is_there(table: Turntable, axis: int, command: AxisTo) -> bool:
    """Return whether an axis is where a command brings it."""
    return abs(table.angle_deg(axis) - command.angle_deg) < THERE_DEG
