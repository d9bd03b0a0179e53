"""How the sensor comes to stand as a position or a turn wants: by the table's axes, or by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

from station.method.motion import AxisTo

from .directions import in_words
from .parameters import NineAxisParameters, pose_unit, position_unit
from .work import (
    MOUNT_TABLE,
    TURNTABLE,
    axes_of,
    direction_prompt,
    pose_prompt,
    to_position,
    to_up,
    to_zero,
    up_prompt,
)

if TYPE_CHECKING:
    from station.method.run import Run
    from station.procedure import Prompt

LOOK_S = 0.5


@dataclass
class Placement:
    """What this process of a run has done so that the sensor stands: last request, and table."""

    asked_for: str = ""
    table_is_ready: bool = False


def ask_to_place(run: Run, unit: str) -> None:
    """Have the sensor put where a unit of work needs it, before it is switched on."""
    parameters: NineAxisParameters = run.parameters
    if parameters.positioning == "table":
        ask_to_put(run, MOUNT_TABLE)
        return
    for position in parameters.all_positions:
        if unit == position_unit(position):
            ask_to_put(run, pose_prompt(position))
    for word in parameters.poses:
        if unit == pose_unit(word):
            ask_to_put(run, direction_prompt(word))


def ask_to_put(run: Run, prompt: Prompt, *, again: bool = False) -> None:
    """Ask for the sensor to be put somewhere, unless it was put there last."""
    placement = run.state(Placement)
    if again:
        run.ask_again(prompt)
    elif placement.asked_for != prompt.id:
        run.ask(prompt)
    placement.asked_for = prompt.id


def make_table_ready(run: Run) -> None:
    """Close the servos of the table's axes, once in a process; the others than the vertical at 0.

    The axes' zeros are looked for where the table does not know them.
    """
    from station.method.verbs import come_to_rest
    from station.roles import Turntable

    placement = run.state(Placement)
    if placement.table_is_ready:
        return
    table = run.role(TURNTABLE, Turntable)
    table.programme_limits()
    axes = axes_of(run.bench)
    for axis in (run.parameters.table_axis,) if axes is None else astuple(axes):
        if not table.is_homed(axis):
            table.home(axis)
            doing = "the table looks for its zeros"
            come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S)
    if axes is not None:
        go_to(run, to_zero(), "the table goes to zero")
    placement.table_is_ready = True


def put(run: Run, position: int, *, again: bool) -> None:
    """Bring the sensor into a position, by the table or by hand."""
    if run.parameters.positioning == "table":
        ask_to_put(run, MOUNT_TABLE)
        go_to(run, to_position(position), f"the table goes to position {position}")
    else:
        ask_to_put(run, pose_prompt(position), again=again)


def lay(run: Run, word: str, *, again: bool) -> None:
    """Bring a direction of the sensor up, at rest, by the table or by hand."""
    if run.parameters.positioning == "table":
        ask_to_put(run, MOUNT_TABLE)
        go_to(run, to_up(word), f"the table goes to {in_words(word)}")
    else:
        ask_to_put(run, direction_prompt(word), again=again)


def turn_up(run: Run, word: str) -> None:
    """Bring an axis of the sensor up or down, along the table's axis that turns."""
    if run.parameters.positioning == "table":
        ask_to_put(run, MOUNT_TABLE)
        go_to(run, to_up(word), f"the table goes to {in_words(word)}")
    else:
        ask_to_put(run, up_prompt(word))


def go_to(run: Run, moves: Sequence[AxisTo], doing: str) -> None:
    """Bring axes of the table to angles, each at rest before the next moves."""
    from station.method.verbs import come_to_rest

    for move in moves:
        run.apply(move)
        number = move.axis_number(run.bench)
        come_to_rest(run, TURNTABLE, doing, axis=number, every_s=LOOK_S)
