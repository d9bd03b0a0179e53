"""How the sensor comes onto the table, and the table to its zeros and angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import ConditionNotReached
from station.method.commands import Power
from station.method.motion import AxisTo
from station.method.verbs import come_to_rest
from station.procedure import Prompt
from station.roles import Navigator, Turntable

from .parameters import HOME, MotionParameters
from .work import IMU, NAVIGATOR, POWER, TURNTABLE, moves

if TYPE_CHECKING:
    from station.method.run import Run

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
        number = move.axis_number(run.bench)
        if not table.is_homed(number):
            table.home(number)
            come_to_rest(
                run, TURNTABLE, "the table looks for its zeros", axis=number, every_s=LOOK_S
            )
    go_to(run, to_zero)
    align(run)
    state.is_ready = True


def turn_device(run: Run) -> None:
    """Have the device turned by half a turn on its plate, and the axes at zero after that."""
    ask_at_rest(run, TURN[run.parameters.motion.device])
    go_to(run, moves(HOME, "all axes to zero"))
    align(run)


def align(run: Run) -> None:
    """Let a navigator find its attitude; ConditionNotReached where it does not."""
    parameters: MotionParameters = run.parameters.motion
    if parameters.device != NAVIGATOR:
        return
    navigator = run.role(NAVIGATOR, Navigator)
    navigator.align(parameters.latitude_deg)
    until_s = run.now_s + parameters.align_at_most_s
    while not navigator.status().aligned:
        run.wait(ALIGN_LOOK_S, "the navigator aligns")
        if run.now_s > until_s:
            raise ConditionNotReached(
                f"{NAVIGATOR} was not aligned within {parameters.align_at_most_s / 60.0:g} min; "
                "look at what it reports, and that nothing shakes the table"
            )


def go_to(run: Run, commands: Sequence[AxisTo]) -> None:
    """Bring axes to angles, each at rest before the next moves; one that is there stays."""
    table = run.role(TURNTABLE, Turntable)
    for command in commands:
        number = command.axis_number(run.bench)
        if abs(table.angle_deg(number) - command.angle_deg) < THERE_DEG:
            continue
        run.apply(command)
        come_to_rest(run, TURNTABLE, command.text, axis=number, every_s=LOOK_S)
