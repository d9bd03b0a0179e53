"""How the sensor comes to stand as a position or a turn wants: by the table's axes, or by hand.

On a table of three axes the sensor is mounted once, X along the inner and Z along the outer axis.
With all axes at zero the table's plate is level and its inner axis points north; a positive turn of
the outer axis is clockwise seen from above, one of the inner axis lets what was west go up, one of
the middle axis what was north. What a person does takes a time that nobody knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import partial
from typing import TYPE_CHECKING

from station.method.duration import on_the_way
from station.method.motion import AxisTo
from station.method.verbs import axis_of, come_to_rest
from station.procedure import Prompt
from station.roles import Turntable
from station.roles.turntable import TableAxes, table_axes

from .directions import ending, in_words, table_angles_deg
from .parameters import NineAxisParameters, pose_unit, position_unit

if TYPE_CHECKING:
    from station.method.run import Run

TURNTABLE = "turntable"
RATES = ("parameters", "rates")
LOOK_S = 0.5
MOVE_S = 10.0
STANDS = {
    1: "X east, Y north, Z up",
    2: "X south, Y east, Z up",
    3: "X north, Y up, Z east",
    4: "X west, Y south, Z up",
    5: "X north, Y west, Z up",
    6: "X south, Y up, Z west",
}
POSES_DEG: dict[int, tuple[float, float, float]] = {
    1: (90.0, 0.0, 0.0),
    2: (180.0, 0.0, 0.0),
    3: (0.0, 0.0, 90.0),
    4: (-90.0, 0.0, 0.0),
    5: (0.0, 0.0, 0.0),
    6: (180.0, 0.0, 90.0),
}
"""Outer, middle and inner angle of each position."""
MOUNT_TABLE = Prompt(
    "mount-table",
    "Mount the sensor on the turntable, its X along the inner axis and its Z along the outer axis: "
    "with all axes at zero X points north, Y west and Z up. Connect its cable.",
    picture="mounting.svg",
    checklist=(
        "The sensor is bolted, its cable free of the axes.",
        "Nobody is within reach of the table.",
    ),
    then="the sensor is switched on and the table moves",
)


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
    placement = run.state(Placement)
    if placement.table_is_ready:
        return
    table = run.role(TURNTABLE, Turntable)
    table.programme_limits()
    axes = run.read(partial(axes_of, run), assumed=TableAxes(1, 2, 3))
    for axis in (run.parameters.table_axis,) if axes is None else astuple(axes):
        if not run.read(partial(table.is_homed, axis), assumed=True):
            table.home(axis)
            doing = "the table looks for its zeros"
            come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S)
    if axes is not None:
        go_to(run, to_zero(), "the table goes to zero")
    placement.table_is_ready = True


def axes_of(run: Run) -> TableAxes | None:
    """Return which axis is which by the bench file; None for a table that only turns."""
    return table_axes(run.bench.instruments[TURNTABLE].settings)


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
    each = on_the_way(MOVE_S / len(moves))
    for move in moves:
        run.apply(move)
        axis = axis_of(run, move)
        come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S, takes=each)


def moves(text: str, **angles_deg: float) -> tuple[AxisTo, ...]:
    """Return the commands that bring axes of a table, by name, to angles, one after the other."""
    return tuple(
        AxisTo(TURNTABLE, axis, text, angle_deg=angle_deg, decided_by=RATES)
        for axis, angle_deg in angles_deg.items()
    )


def to_zero() -> tuple[AxisTo, ...]:
    """Return the moves that level the table's plate, its inner axis then to the north."""
    return moves("middle and inner axis to 0 deg", middle=0.0, inner=0.0)


def to_position(position: int) -> tuple[AxisTo, ...]:
    """Return the moves of a three-axis table to one of the positions."""
    outer_deg, middle_deg, inner_deg = POSES_DEG[position]
    angles = f"{outer_deg:g} deg, {middle_deg:g} deg, {inner_deg:g} deg"
    text = f"position {position}: outer, middle and inner axis to {angles}"
    return moves(text, outer=outer_deg, middle=middle_deg, inner=inner_deg)


def to_up(word: str) -> tuple[AxisTo, ...]:
    """Return the moves of a three-axis table that let a direction of the sensor point up."""
    middle_deg, inner_deg = table_angles_deg(word)
    text = f"{in_words(word)}: middle and inner axis to {middle_deg:g} deg, {inner_deg:g} deg"
    return moves(text, middle=middle_deg, inner=inner_deg)


def pose_prompt(position: int) -> Prompt:
    """Return the request to put the sensor on the plate in a position."""
    return Prompt(
        f"pose-{position}",
        f"Put the sensor, in its tooling, its cable connected, on the north-referenced plate in "
        f"position {position}: {STANDS[position]}. Then leave the plate alone.",
        then="the sensor is read at rest; nothing moves",
    )


def direction_prompt(word: str) -> Prompt:
    """Return the request to put the sensor on the plate with a direction up."""
    return Prompt(
        f"pose-{ending(word)}",
        f"Put the sensor, in its tooling, its cable connected, on the plate with {in_words(word)}, "
        "whichever way it faces. Then leave the plate alone.",
        then="the sensor is read at rest; nothing moves",
    )


def up_prompt(word: str) -> Prompt:
    """Return the request to mount the sensor on a table of one axis."""
    return Prompt(
        f"mount-{ending(word)}",
        f"Mount the sensor on the turntable with {in_words(word)}, along the table's axis.",
        checklist=("Nobody is within reach of the table.",),
        then="the table turns",
    )
