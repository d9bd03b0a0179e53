"""How the sensor has to stand, by table or by hand, and why a plan cannot run on a bench.

On a table of three axes the sensor is mounted once, X along the inner and Z along the outer axis.
With all axes at zero the table's plate is level and its inner axis points north; a positive turn of
the outer axis is clockwise seen from above, one of the inner axis lets what was west go up, one of
the middle axis what was north.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station import registry
from station.procedure import Problem, Prompt, RecordUse
from station.roles.turntable import TableAxes, table_axes, unnamed_axes

from .parameters import AXES, FULL_TURN_DEG, NineAxisParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TURNTABLE = "turntable"
IMU = "imu"
POWER = "dut_power"
RATES = ("parameters", "rates")
RATE = "rate"
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


def instruments(parameters: NineAxisParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    return (TURNTABLE, IMU, POWER)


def records(parameters: NineAxisParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the table's angle."""
    return (RecordUse(TURNTABLE, "angle", FULL_TURN_DEG, "deg"),)


def check(parameters: NineAxisParameters, bench: Bench) -> Iterator[Problem]:
    """Yield each rate that the sensor cannot follow, and what the bench does not say of its table.

    A sensor's range is the bench file's `rate` limit of the imu.
    """
    table = bench.instruments.get(TURNTABLE)
    if table is not None and parameters.positioning == "table":
        for what in unnamed_axes(TURNTABLE, table.settings):
            yield Problem(("parameters", "positioning"), f"{what}, or take positioning: plate")
    sensor = bench.instruments.get(IMU)
    if sensor is None:
        return
    driver = registry.load(registry.DRIVERS, sensor.driver)
    if said := getattr(driver, "rates_said", lambda rate_Hz: "")(parameters.sample_rate_Hz):
        yield Problem(("parameters", "sample_rate"), said)
    range_deg_per_s = sensor.limits.get(RATE)
    if range_deg_per_s is None:
        return
    for rate in parameters.rates_deg_per_s:
        if rate >= range_deg_per_s:
            yield Problem(
                RATES,
                f"{rate:g} deg/s is not below the gyro's range on this bench, "
                f"{range_deg_per_s:g} deg/s",
            )


def axes_of(bench: Bench) -> TableAxes | None:
    """Return which axis is which by the bench file; None for a table that only turns."""
    table = bench.instruments.get(TURNTABLE)
    return None if table is None else table_axes(table.settings)


def axes_to_close(bench: Bench, parameters: NineAxisParameters) -> tuple[int, ...]:
    """Return the numbers of the table's axes whose servos a run closes."""
    axes = axes_of(bench)
    if axes is not None:
        return (axes.outer, axes.middle, axes.inner)
    return (parameters.table_axis,)


def turning_axis(bench: Bench, parameters: NineAxisParameters) -> int:
    """Return the number of the table's vertical axis."""
    axes = axes_of(bench)
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
