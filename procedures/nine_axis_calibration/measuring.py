"""One unit of work: a position at rest, its pose checked, or whole turns at one rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from station.errors import ConditionNotReached, InstrumentError

from .check import (
    IMU,
    MOUNT_TABLE,
    POSES_DEG,
    TURNTABLE,
    UP_DEG,
    UP_SENSE,
    axes_of,
    pose_prompt,
    turning_axis,
    up_prompt,
)
from .evaluate import pose_limits
from .parameters import (
    AXES,
    FULL_TURN_DEG,
    LONGEST_READING_S,
    SHORTEST_READING_S,
    NineAxisParameters,
    Turn,
    position_unit,
)
from .pose import Pose, check_pose
from .sensing import ACCELEROMETER_BITS, GYRO_BITS, SECONDS_PER_HOUR, Sensing

if TYPE_CHECKING:
    from station.procedure import Prompt
    from station.runner.run import Run

PLACE = "where the sensor was put"
FIRST_LOOK_S = 20.0
"""After so long a pose is judged first: a wrong one must not cost the whole static time."""
MOVING_LOOK_S = 0.5
EXTRA_S = 0.1
"""So much more than the whole turns is recorded, and a reading more."""
LATE_OUTPUTS_S = 0.2
"""Outputs of a record's last moments may still be on their way when it ends."""
LATE = 1.5
LATE_S = 10.0
FOLLOWS = 0.5
TABLE_COLUMNS = {
    "angle_deg": "deg, the encoder of the axis that turns, turns counted, clockwise from above",
    "asked_time_s": "s, run time at which it was asked for",
}


def stand(run: Run, position: int, said: str) -> None:
    """Measure one position; a wrong pose is measured again, and stays refused by the analysis."""
    parameters: NineAxisParameters = run.parameters
    unit = position_unit(position)
    if run.is_finished(unit):
        return
    run.may_pause()
    run.record.event("unit-started", durable=False, unit=unit)
    for attempt in range(1, parameters.pose.attempts + 1):
        put(run, position, again=attempt > 1)
        left = parameters.pose.attempts - attempt
        from_s, until_s, pose = record_at_rest(run, position, said, whole=left == 0)
        if pose.right:
            break
        run.record.event("pose-refused", unit=unit, attempt=attempt, why=pose.why)
        then = "it is measured again" if left else "the record counts as of a wrong position"
        run.progress.say(f"    {unit}: {pose.why}{looks_like(pose)}; {then}")
    run.record.finish_unit(
        unit, position=position, from_s=from_s, until_s=until_s, attempts=attempt, right=pose.right
    )


def need_sensor_well(run: Run) -> None:
    """Raise InstrumentError where the sensor says of itself that something is wrong."""
    from station.roles import Imu

    faults = run.role(IMU, Imu).status().faults
    if faults:
        raise InstrumentError(
            IMU,
            "asked for its status",
            f"it tells {', '.join(faults)}",
            "switch it off and on; where it tells the same again have it looked at",
        )


def ask_to_place(run: Run, unit: str) -> None:
    """Have the sensor put where a unit of work needs it, before it is switched on."""
    parameters: NineAxisParameters = run.parameters
    if parameters.positioning == "table":
        ask_to_put(run, MOUNT_TABLE)
        return
    for position in parameters.all_positions:
        if unit == position_unit(position):
            ask_to_put(run, pose_prompt(position))


def ask_to_put(run: Run, prompt: Prompt, *, again: bool = False) -> None:
    """Ask for the sensor to be put somewhere, unless it was put there last."""
    if again:
        run.ask_again(prompt.id, prompt.text)
    elif run.handed_on.get(PLACE) != prompt.id:
        run.ask(prompt.id, prompt.text)
    run.handed_on[PLACE] = prompt.id


def put(run: Run, position: int, *, again: bool) -> None:
    """Bring the sensor into a position, by the table or by hand."""
    axes = axes_of(run.bench)
    if run.parameters.positioning == "table" and axes is not None:
        ask_to_put(run, MOUNT_TABLE)
        for axis, angle_deg in zip(
            (axes.outer, axes.middle, axes.inner), POSES_DEG[position], strict=True
        ):
            go_to(run, axis, angle_deg, f"the table goes to position {position}")
        return
    ask_to_put(run, pose_prompt(position), again=again)


def record_at_rest(run: Run, position: int, said: str, *, whole: bool) -> tuple[float, float, Pose]:
    """Record a position and judge it; returns begin and end of what counts, and the judgement.

    A pose that is wrong from the beginning ends the record at once, unless it is to be `whole`: it
    is then the analysis that decides, with the biases free.
    """
    parameters: NineAxisParameters = run.parameters
    sensing = Sensing(run, position_unit(position))
    sensing.follow(run.clock.now() + parameters.static_settle_s, f"{said}, it comes to rest")
    from_s = run.clock.now()
    for lasts_s in (min(FIRST_LOOK_S, parameters.static_time_s), parameters.static_time_s):
        sensing.follow(from_s + lasts_s, said)
        until_s = run.clock.now()
        sensing.need_valid(from_s, {**GYRO_BITS, **ACCELEROMETER_BITS})
        limits = pose_limits(parameters)
        pose = check_pose(position, *sensing.means(from_s), parameters.latitude_deg, limits)
        if not pose.right and not whole:
            break
    sensing.follow(run.clock.now() + LATE_OUTPUTS_S, said)
    sensing.stop()
    return from_s, until_s, pose


def looks_like(pose: Pose) -> str:
    """Return in words as which other position the sensor stands."""
    return "" if pose.stands_as is None else f", as in position {pose.stands_as}"


def turn_up(run: Run, axis: str) -> None:
    """Bring an axis of the sensor up, along the table's axis that turns."""
    axes = axes_of(run.bench)
    if run.parameters.positioning == "table" and axes is not None:
        ask_to_put(run, MOUNT_TABLE)
        for number, angle_deg in zip((axes.middle, axes.inner), UP_DEG[axis], strict=True):
            go_to(run, number, angle_deg, f"{axis} is turned up")
        return
    ask_to_put(run, up_prompt(axis))


def go_to(run: Run, axis: int, angle_deg: float, said: str) -> None:
    """Turn one table axis to an angle and wait until it rests there."""
    from station.roles import Turntable

    table = run.role(TURNTABLE, Turntable)
    table.move_to(axis, angle_deg)
    while table.is_moving(axis):
        run.clock.sleep(MOVING_LOOK_S)
        run.say_progress(said)


def turn(run: Run, one: Turn, said: str) -> None:
    """Record whole turns at one rate in one sense, spin-up and settling left out."""
    from station.roles import Turntable

    parameters: NineAxisParameters = run.parameters
    if run.is_finished(one.unit):
        return
    run.may_pause()
    run.record.event("unit-started", durable=False, unit=one.unit)
    table, axis = run.role(TURNTABLE, Turntable), turning_axis(run.bench, parameters)
    sensing = Sensing(run, one.unit)
    table.turn(axis, UP_SENSE * one.rate_deg_per_s)
    while not table.is_at_rate(axis):
        sensing.follow(run.clock.now() + MOVING_LOOK_S, f"{said}, the table spins up")
    settled_s = run.clock.now() + parameters.settle_s
    while run.clock.now() < settled_s:
        ahead_s = min(run.clock.now() + LONGEST_READING_S, settled_s)
        sensing.follow(ahead_s, f"{said}, the rate settles")
        table.is_at_rate(axis)  # raises where it does not keep it
    # The line is then free for the first reading as it is for all others.
    sensing.follow(run.clock.now() + SHORTEST_READING_S, said)
    from_s = run.clock.now()
    turned_deg = read_turns(run, one, axis, sensing, said)
    until_s = run.clock.now()
    across = {part: bit for part, bit in GYRO_BITS.items() if not part.endswith(one.axis)}
    sensing.need_valid(from_s, across)
    need_gyro_follows(one, sensing, from_s, UP_SENSE * turned_deg / (until_s - from_s))
    table.stop(axis)
    sensing.follow(run.clock.now() + LATE_OUTPUTS_S, f"{said}, the table stops")
    sensing.stop()
    while table.is_moving(axis):
        run.clock.sleep(MOVING_LOOK_S)
    run.record.finish_unit(
        one.unit,
        axis=one.axis,
        rate_deg_per_s=one.rate_deg_per_s,
        turns=one.turns,
        from_s=from_s,
        until_s=until_s,
    )


def read_turns(run: Run, one: Turn, axis: int, sensing: Sensing, said: str) -> float:
    """Read the table's angle until the turns are whole; returns the angle turned, as it counts.

    Raises ConditionNotReached where they take far longer than they should.
    """
    every_s = one.reading_interval_s
    wanted_deg = one.turns * FULL_TURN_DEG + (every_s + EXTRA_S) * abs(one.rate_deg_per_s)
    gives_up_s = run.clock.now() + LATE * one.dwell_s + LATE_S
    first_deg = angle_deg = read_angle(run, one.unit, axis)
    while abs(angle_deg - first_deg) < wanted_deg:
        left_s = (wanted_deg - abs(angle_deg - first_deg)) / abs(one.rate_deg_per_s)
        turned = abs(angle_deg - first_deg) / FULL_TURN_DEG
        next_s = run.clock.now() + min(every_s, max(left_s, SHORTEST_READING_S))
        sensing.follow(next_s, f"{said}, turn {turned:.1f} of {one.turns}")
        angle_deg = read_angle(run, one.unit, axis)
        if run.clock.now() > gives_up_s:
            raise ConditionNotReached(
                f"{TURNTABLE} has made {turned:.2f} of {one.turns} turns at "
                f"{one.rate_deg_per_s:g} deg/s in {LATE * one.dwell_s + LATE_S:.0f} s; look "
                "whether something holds it"
            )
    return angle_deg - first_deg


def read_angle(run: Run, unit: str, axis: int) -> float:
    """Record what the encoder reads, with the times before and after it was asked for."""
    from station.record.raw import ARRIVAL
    from station.roles import Turntable

    asked_s = run.clock.now()
    angle_deg = run.role(TURNTABLE, Turntable).angle_deg(axis)
    names = [(name, np.float64) for name in (*TABLE_COLUMNS, ARRIVAL)]
    row = np.array([(angle_deg, asked_s, run.clock.now())], dtype=names)
    run.record.block(TURNTABLE, unit, TABLE_COLUMNS, row)
    return angle_deg


def need_gyro_follows(one: Turn, sensing: Sensing, from_s: float, rate_deg_per_s: float) -> None:
    """Raise ConditionNotReached where the gyro that is up does not feel the turns as they are.

    A gyro that saturates is no reason: its samples are left out and flagged.
    """
    gyro, _ = sensing.means(from_s)
    felt = gyro / SECONDS_PER_HOUR
    own = float(felt[AXES.index(one.axis)])
    if not own / rate_deg_per_s < FOLLOWS:
        return
    most = AXES[int(np.nanargmax(np.abs(felt)))]
    raise ConditionNotReached(
        f"gyro {one.axis} of {IMU} reads {own:.4g} deg/s while {TURNTABLE} turns at "
        f"{rate_deg_per_s:.4g} deg/s (positive: counter-clockwise from above), gyro {most} "
        f"{float(np.nanmax(np.abs(felt))):.4g} deg/s; look how the sensor is mounted, which axis "
        "is up, and which of the table's axes is which in the bench file"
    )
