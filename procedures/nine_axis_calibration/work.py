"""What a run commands and records, how the sensor has to stand, and why a plan cannot run.

On a table of three axes the sensor is mounted once, X along the inner and Z along the outer axis.
With all axes at zero the table's plate is level and its inner axis points north; a positive turn of
the outer axis is clockwise seen from above, one of the inner axis lets what was west go up, one of
the middle axis what was north.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station import registry
from station.method.commands import Power
from station.method.motion import AxisAtRate, AxisTo
from station.method.set_points import Bounded
from station.method.work import NO_TIME, Duration, Rows, Work, on_the_way
from station.procedure import Problem, Prompt, RecordUse
from station.roles.turntable import TableAxes, table_axes, unnamed_axes

from .directions import ending, in_words, table_angles_deg
from .parameters import (
    FULL_TURN_DEG,
    SHORTEST_READING_S,
    NineAxisParameters,
    Turn,
    pose_unit,
    position_unit,
)

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TURNTABLE = "turntable"
IMU = "imu"
POWER = "dut_power"
RATES = ("parameters", "rates")
TURNED_DOWN = ("parameters", "turned_down_rates")
RATE = "rate"
CLOSE_S, MOVE_S, SETTLING_S = 10.0, 10.0, 3.0
USUAL_ACCELERATION_DEG_PER_S2 = 50.0
EXTRA_S = 0.1
"""So much more than the whole turns is recorded, and a reading more."""
LATE_OUTPUTS_S = 0.2
"""Outputs of a record's last moments may still be on their way when it ends."""
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
UP_SENSE = -1.0
"""Rates are positive counter-clockwise seen from above, the table's outer axis turns clockwise."""
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
    if refusal := getattr(driver, "rates_said", lambda rate_Hz: "")(parameters.sample_rate_Hz):
        yield Problem(("parameters", "sample_rate"), refusal)
    range_deg_per_s = sensor.limits.get(RATE)
    if range_deg_per_s is None:
        return
    turned_down = parameters.turned_down_rates_deg_per_s if parameters.turned_down else ()
    for rate in (*parameters.rates_deg_per_s, *turned_down):
        if rate >= range_deg_per_s:
            yield Problem(
                RATES if rate in parameters.rates_deg_per_s else TURNED_DOWN,
                f"{rate:g} deg/s is not below the gyro's range on this bench, "
                f"{range_deg_per_s:g} deg/s",
            )


def axes_of(bench: Bench) -> TableAxes | None:
    """Return which axis is which by the bench file; None for a table that only turns."""
    table = bench.instruments.get(TURNTABLE)
    return None if table is None else table_axes(table.settings)


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


def spin(parameters: NineAxisParameters, turn: Turn) -> AxisAtRate:
    """Return the command that lets the vertical axis turn for a record."""
    return AxisAtRate(
        TURNTABLE,
        "outer",
        f"{turn.unit}: {turn.turns} turn{'s' if turn.turns > 1 else ''}",
        parameters.table_axis,
        UP_SENSE * turn.rate_deg_per_s,
        decided_by=RATES,
    )


def record_s(parameters: NineAxisParameters, turn: Turn) -> float:
    """Return the bench time in s of one record on the table, settling and late outputs included."""
    beyond_s = SHORTEST_READING_S + turn.reading_interval_s + EXTRA_S + LATE_OUTPUTS_S
    return parameters.settle_s + turn.dwell_s + beyond_s


def moving_s(turn: Turn) -> Duration:
    """Return the bench time to the rate of a record, and to rest again."""
    return on_the_way(2.0 * abs(turn.rate_deg_per_s) / USUAL_ACCELERATION_DEG_PER_S2 + SETTLING_S)


def resting(parameters: NineAxisParameters, record_s: float, way: Duration) -> Duration:
    """Return the bench time of a pose beside its first record: a wrong one is measured again."""
    again = parameters.pose.attempts - 1
    once_more = parameters.static_settle_s + record_s + LATE_OUTPUTS_S + way.longest_s
    return way + Duration(0.0, 0.0, again * once_more)


def work(parameters: NineAxisParameters) -> Iterator[Work]:
    """Yield warm-up, each position, each axis up with its records, and the end.

    Without a three-axis table a person moves the sensor, and that time is unknown.
    """
    by_table = parameters.positioning == "table"
    sample_rate_Hz = parameters.sample_rate_Hz
    way, closing = (on_the_way(MOVE_S), on_the_way(CLOSE_S)) if by_table else (NO_TIME, NO_TIME)
    settle_s = parameters.static_settle_s + LATE_OUTPUTS_S
    on = (Power(POWER, True), *(to_zero() if by_table else ()))
    yield Work("1a", None, on, (), parameters.warm_up_s, decided=closing)
    for position in parameters.all_positions:
        rest_s = parameters.static_time_s + settle_s
        yield Work(
            "1b",
            position_unit(position),
            (
                *(to_position(position) if by_table else ()),
                Bounded(IMU, f"position {position}, {STANDS[position]}: record"),
            ),
            (Rows(IMU, rest_s, rest_s * sample_rate_Hz),),
            rest_s,
            decided=resting(parameters, parameters.static_time_s, way),
        )
    for word in parameters.poses:
        rest_s = parameters.pose_time_s + settle_s
        yield Work(
            "1b",
            pose_unit(word),
            (*(to_up(word) if by_table else ()), Bounded(IMU, f"{in_words(word)}: record")),
            (Rows(IMU, rest_s, rest_s * sample_rate_Hz),),
            rest_s,
            decided=resting(parameters, parameters.pose_time_s, way),
        )
    if not by_table:
        yield Work("2a", None, to_zero(), (), decided=on_the_way(CLOSE_S))
    for word in parameters.all_turned:
        if by_table:
            yield Work("2a", None, to_up(word), (), decided=way)
        for turn in parameters.all_turns:
            if turn.axis == word:
                recorded_s, moving = record_s(parameters, turn), moving_s(turn)
                spin_s = recorded_s + moving.expected_s
                rows = (
                    Rows(IMU, spin_s, spin_s * sample_rate_Hz),
                    Rows(TURNTABLE, spin_s, turn.dwell_s / turn.reading_interval_s),
                )
                turning = (spin(parameters, turn),)
                yield Work("2a", turn.unit, turning, rows, recorded_s, decided=moving)
    yield Work("2b", commands=(Power(POWER, False),))


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


def prompts(parameters: NineAxisParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    if parameters.positioning == "table":
        return (MOUNT_TABLE,)
    on_plate = (pose_prompt(position) for position in parameters.all_positions)
    leaning = (direction_prompt(word) for word in parameters.poses)
    return (*on_plate, *leaning, *(up_prompt(word) for word in parameters.all_turned))
