"""How the sensor comes to stand as a position or a turn wants: by the table's axes, or by hand.

On a table of three axes the sensor is mounted once, X along the inner and Z along the outer axis.
With all axes at zero the table's plate is level and its inner axis points north; a positive turn of
the outer axis is clockwise seen from above, one of the inner axis lets what was west go up, one of
the middle axis what was north.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.nine_axis_calibration.check import AXIS_SETTINGS, TURNTABLE
from procedures.nine_axis_calibration.parameters import AXES, NineAxisParameters
from station.procedure import Prompt

if TYPE_CHECKING:
    from station.instruments.bench import Bench

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
UP_DEG: dict[str, tuple[float, float]] = {"X": (90.0, 0.0), "Y": (0.0, 90.0), "Z": (0.0, 0.0)}
"""Middle and inner angle that let a sensor axis point up, along the outer axis."""
UP_SENSE = -1.0
"""Rates are positive counter-clockwise seen from above, the table's outer axis turns clockwise."""

MOUNT_TABLE = Prompt(
    "mount-table",
    "Mount the sensor on the turntable, its X along the inner axis and its Z along the outer axis: "
    "with all axes at zero X points north, Y west and Z up. Connect its cable.",
)


@dataclass(frozen=True)
class TableAxes:
    """Numbers of a three-axis table's axes: the outer one is vertical and carries the middle."""

    outer: int
    middle: int
    inner: int


def table_axes(bench: Bench) -> TableAxes | None:
    """Return which axis is which by the bench file; None for a table that only turns."""
    table = bench.instruments.get(TURNTABLE)
    numbers = [table.settings.get(key) for key in AXIS_SETTINGS] if table is not None else []
    if len(numbers) < len(AXIS_SETTINGS) or not all(isinstance(one, int) for one in numbers):
        return None
    return TableAxes(*(int(str(one)) for one in numbers))


def axes_to_close(bench: Bench, parameters: NineAxisParameters) -> tuple[int, ...]:
    """Return the numbers of the table's axes whose servos a run closes."""
    axes = table_axes(bench)
    if axes is not None:
        return (axes.outer, axes.middle, axes.inner)
    return (parameters.table_axis,)


def turning_axis(bench: Bench, parameters: NineAxisParameters) -> int:
    """Return the number of the table's vertical axis."""
    axes = table_axes(bench)
    return parameters.table_axis if axes is None else axes.outer


def pose_prompt(position: int) -> Prompt:
    """Return the request to put the sensor on the plate in a position."""
    return Prompt(
        f"pose-{position}",
        f"Put the sensor, in its tooling, its cable connected, on the north-referenced plate in "
        f"position {position}: {STANDS[position]}. Then leave the plate alone.",
    )


def up_prompt(axis: str) -> Prompt:
    """Return the request to mount the sensor on a table of one axis."""
    return Prompt(
        f"mount-{axis}-up",
        f"Mount the sensor on the turntable with {axis} up, along the table's axis.",
    )


def prompts(parameters: NineAxisParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    if parameters.positioning == "table":
        return (MOUNT_TABLE,)
    on_plate = (pose_prompt(position) for position in parameters.all_positions)
    return (*on_plate, *(up_prompt(axis) for axis in AXES))
