"""How the sensor comes to stand as a position or a turn wants: by the table's axes, or by hand.

On a table of three axes the sensor is mounted once, X along the inner and Z along the outer axis.
With all axes at zero the table's plate is level and its inner axis points north; a positive turn of
the outer axis is clockwise seen from above, one of the inner axis lets what was west go up, one of
the middle axis what was north. What a person does takes a time that nobody knows.
"""

from __future__ import annotations

from collections.abc import Mapping
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


@dataclass(frozen=True)
class Stand:
    """How the sensor is to stand, in `words`.

    A person is asked for it by the `prompt`; a table of three axes goes to `angles_deg`, axis by
    axis.
    """

    words: str
    prompt: Prompt
    angles_deg: Mapping[str, float]


def in_position(position: int) -> Stand:
    """Return how the sensor stands on the north-referenced plate in a position."""
    angles_deg = dict(zip(("outer", "middle", "inner"), POSES_DEG[position], strict=True))
    prompt = Prompt(
        f"pose-{position}",
        f"Put the sensor, in its tooling, its cable connected, on the north-referenced plate in "
        f"position {position}: {STANDS[position]}. Then leave the plate alone.",
        then="the sensor is read at rest; nothing moves",
    )
    return Stand(f"position {position}", prompt, angles_deg)


def in_pose(word: str) -> Stand:
    """Return how the sensor stands on the plate with a direction up."""
    prompt = Prompt(
        f"pose-{ending(word)}",
        f"Put the sensor, in its tooling, its cable connected, on the plate with {in_words(word)}, "
        "whichever way it faces. Then leave the plate alone.",
        then="the sensor is read at rest; nothing moves",
    )
    return Stand(in_words(word), prompt, _angles_deg(word))


def on_table(word: str) -> Stand:
    """Return how the sensor stands on the turning table with an axis up or down."""
    prompt = Prompt(
        f"mount-{ending(word)}",
        f"Mount the sensor on the turntable with {in_words(word)}, along the table's axis.",
        checklist=("Nobody is within reach of the table.",),
        then="the table turns",
    )
    return Stand(in_words(word), prompt, _angles_deg(word))


def _angles_deg(word: str) -> dict[str, float]:
    return dict(zip(("middle", "inner"), table_angles_deg(word), strict=True))


def place(run: Run, target: Stand, *, again: bool = False) -> None:
    """Bring the sensor to a stand, by the table or by hand."""
    if run.parameters.positioning == "plate":
        ask_to_put(run, target.prompt, again=again)
        return
    ask_to_put(run, MOUNT_TABLE)
    *first, last = target.angles_deg
    angles = ", ".join(f"{angle_deg:g} deg" for angle_deg in target.angles_deg.values())
    text = f"{target.words}: {', '.join(first)} and {last} axis to {angles}"
    go_to(run, text, target.angles_deg, f"the table goes to {target.words}")


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
        to_zero = "middle and inner axis to 0 deg", {"middle": 0.0, "inner": 0.0}
        go_to(run, *to_zero, "the table goes to zero")
    placement.table_is_ready = True


def axes_of(run: Run) -> TableAxes | None:
    """Return which axis is which by the bench file; None for a table that only turns."""
    return table_axes(run.bench.instruments[TURNTABLE].settings)


def go_to(run: Run, text: str, angles_deg: Mapping[str, float], doing: str) -> None:
    """Bring axes of the table, by name, to angles, each at rest before the next moves."""
    each = on_the_way(MOVE_S / len(angles_deg))
    for name, angle_deg in angles_deg.items():
        move = AxisTo(TURNTABLE, name, text, angle_deg=angle_deg, decided_by=RATES)
        run.apply(move)
        axis = axis_of(run, move)
        come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S, takes=each)
