"""One unit of work: a position at rest, its pose checked, or whole turns at one rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.frozen import IN_A_ROW, longest_run
from station.errors import ConditionNotReached, InstrumentError
from station.method.verbs import Follower, look_until

from .dataset import Array
from .directions import AXES
from .parameters import (
    FULL_TURN_DEG,
    MAX_READING_S,
    SHORTEST_READING_S,
    NineAxisParameters,
    Turn,
    position_unit,
)
from .placing import put
from .pose import Pose, check_pose
from .settings import PoseLimits
from .work import EXTRA_S, IMU, LATE_OUTPUTS_S, TURNTABLE, UP_SENSE, spin

if TYPE_CHECKING:
    from station.method.run import Run


LOOK_S = 2.0
"""Run time between two looks; less where time runs by itself, so that a kill loses little."""
FROZEN_AFTER_S = 2.0
"""Noise never gives three gyros and three accelerometers the same values for so long, all six."""
SECONDS_PER_HOUR = 3600.0
MOSTLY = 0.5
GYRO_BITS = {"gyro X": 0, "gyro Y": 1, "gyro Z": 2}
ACCELEROMETER_BITS = {"accelerometer X": 4, "accelerometer Y": 5, "accelerometer Z": 6}
"""Bits of an output's status that are set while a part is not valid."""
GYROS = tuple(f"gyro_{axis}_deg_per_s" for axis in "xyz")
ACCELEROMETERS = tuple(f"accelerometer_{axis}_g" for axis in "xyz")
FIRST_LOOK_S = 20.0
"""After so long a pose is judged first: a wrong one must not cost the whole static time."""
MOVING_LOOK_S = 0.5
LATE = 1.5
LATE_S = 10.0
FOLLOWS = 0.5
TABLE_COLUMNS = {
    "angle_deg": "deg, the encoder of the axis that turns, turns counted, clockwise from above",
    "asked_time_s": "s, run time at which it was asked for",
}


class Sensing:
    """The sensor's stream for one unit of work; `stop` it when the unit is done."""

    def __init__(self, run: Run, unit: str) -> None:
        from station.roles import Imu

        self._run, self._unit = run, unit
        self._sensor = run.role(IMU, Imu)
        parameters: NineAxisParameters = run.parameters
        self._sensor.start(parameters.sample_rate_Hz)
        self._follower = Follower(run, {IMU: self._sensor})
        self._rows: list[NDArray[Any]] = []
        self._newest = np.empty((0, len(GYROS) + len(ACCELEROMETERS)))
        self._frozen_after = max(math.ceil(FROZEN_AFTER_S * parameters.sample_rate_Hz), IN_A_ROW)

    def follow(self, until_s: float, doing: str) -> None:
        """Record until a run time; raises InstrumentError for a sensor that is silent or frozen."""
        look_until(self._run, until_s, self.look, doing, LOOK_S)

    def look(self) -> None:
        """Record what has come."""
        rows = self._follower.take(self._unit).get(IMU)
        if rows is not None:
            self._rows.append(rows)
            self._need_changes(rows)

    def _need_changes(self, rows: NDArray[Any]) -> None:
        """Raise InstrumentError where new outputs, after those before, repeat one set of values."""
        values = np.column_stack([rows[name] for name in (*GYROS, *ACCELEROMETERS)])
        values = np.concatenate((self._newest, values))
        same = longest_run(values)
        if same >= self._frozen_after:
            raise InstrumentError(
                IMU,
                f"record {self._unit}",
                f"{same} outputs in a row hold the same six rates and specific forces, though "
                "their counter goes on",
                "switch it off and on; where it does so again have it looked at",
            )
        self._newest = values[-self._frozen_after :]

    def means(self, from_s: float) -> tuple[Array, Array]:
        """Return the gyros' means in deg/h and the accelerometers' in g, (3,) each, since a time.

        NaN where nothing came.
        """
        from station.roles.base import ARRIVAL

        rows = [row[row[ARRIVAL] > from_s] for row in self._rows]
        if not any(len(row) for row in rows):
            return np.full(3, np.nan), np.full(3, np.nan)
        together = np.concatenate(rows)
        gyro = np.array([np.nanmean(together[name]) for name in GYROS])
        return gyro * SECONDS_PER_HOUR, np.array([np.nanmean(together[n]) for n in ACCELEROMETERS])

    def need_valid(self, from_s: float, parts: Mapping[str, int]) -> None:
        """Raise InstrumentError for a part, given with its status bit, that mostly is not valid.

        Of the outputs since a time. For parts that nothing drives beyond their range now.
        """
        from station.roles.base import ARRIVAL

        status = [row["status"][row[ARRIVAL] > from_s].astype(np.int64) for row in self._rows]
        if not any(len(word) for word in status):
            raise InstrumentError(
                IMU,
                f"record {self._unit}",
                "no output came during the whole record",
                "check its cable and its power",
            )
        for part, bit in parts.items():
            share = float(np.mean(np.concatenate(status) >> bit & 1))
            if share > MOSTLY:
                raise InstrumentError(
                    IMU,
                    f"record {self._unit}",
                    f"its outputs say that {part} is not valid, {share:.0%} of them, and nothing "
                    "drives it beyond its range",
                    "switch it off and on; where it says the same again have it looked at",
                )

    def stop(self) -> None:
        """End the output and record the rest of it."""
        self._sensor.stop()
        self.look()


def measure_position(run: Run, position: int, doing: str) -> None:
    """Measure one position; a wrong pose is measured again, and stays refused by the analysis."""
    parameters: NineAxisParameters = run.parameters
    unit = position_unit(position)
    if run.is_finished(unit):
        return
    run.may_pause()
    with run.unit(unit, position=position) as facts:
        for attempt in range(1, parameters.pose.attempts + 1):
            put(run, position, again=attempt > 1)
            left = parameters.pose.attempts - attempt
            from_s, until_s, pose = record_at_rest(run, position, doing, whole=left == 0)
            if pose.right:
                break
            run.event("pose-refused", unit=unit, attempt=attempt, why=pose.why)
            then = "it is measured again" if left else "the record counts as of a wrong position"
            run.say(f"    {unit}: {pose.why}{looks_like(pose)}; {then}")
        facts.update(from_s=from_s, until_s=until_s, attempts=attempt, right=pose.right)


def need_sensor_well(run: Run) -> None:
    """Raise InstrumentError where the sensor says of itself that something is wrong."""
    from station.roles import Imu

    faults = run.role(IMU, Imu).status().faults
    if faults:
        raise InstrumentError(
            IMU,
            "asked for its status",
            f"it reports {', '.join(faults)}",
            "switch it off and on; where it reports the same again have it looked at",
        )


def record_at_rest(
    run: Run, position: int, doing: str, *, whole: bool
) -> tuple[float, float, Pose]:
    """Record a position and judge it; returns begin and end of what counts, and the judgement.

    A pose that is wrong from the beginning ends the record at once, unless it is to be `whole`: it
    is then the analysis that decides, with the biases free.
    """
    parameters: NineAxisParameters = run.parameters
    sensing = Sensing(run, position_unit(position))
    sensing.follow(run.now_s + parameters.static_settle_s, f"{doing}, it comes to rest")
    from_s = run.now_s
    for lasts_s in (min(FIRST_LOOK_S, parameters.static_time_s), parameters.static_time_s):
        sensing.follow(from_s + lasts_s, doing)
        until_s = run.now_s
        sensing.need_valid(from_s, {**GYRO_BITS, **ACCELEROMETER_BITS})
        limits = pose_limits(parameters)
        pose = check_pose(position, *sensing.means(from_s), parameters.latitude_deg, limits)
        if not pose.right and not whole:
            break
    sensing.follow(run.now_s + LATE_OUTPUTS_S, doing)
    sensing.stop()
    return from_s, until_s, pose


def looks_like(pose: Pose) -> str:
    """Return in words as which other position the sensor stands."""
    return "" if pose.stands_as is None else f", as in position {pose.stands_as}"


def turn(run: Run, turn: Turn, doing: str) -> None:
    """Record whole turns at one rate in one sense, spin-up and settling left out."""
    from station.roles import Turntable

    parameters: NineAxisParameters = run.parameters
    if run.is_finished(turn.unit):
        return
    run.may_pause()
    command = spin(parameters, turn)
    table, axis = run.role(TURNTABLE, Turntable), command.axis_number(run.bench)
    with run.unit(
        turn.unit, axis=turn.axis, rate_deg_per_s=turn.rate_deg_per_s, turns=turn.turns
    ) as facts:
        sensing = Sensing(run, turn.unit)
        run.apply(command)
        while not table.is_at_rate(axis):
            sensing.follow(run.now_s + MOVING_LOOK_S, f"{doing}, the table spins up")
        settled_s = run.now_s + parameters.settle_s
        while run.now_s < settled_s:
            ahead_s = min(run.now_s + MAX_READING_S, settled_s)
            sensing.follow(ahead_s, f"{doing}, the rate settles")
            table.is_at_rate(axis)  # raises where it does not keep it
        # The line is then free for the first reading as it is for all others.
        sensing.follow(run.now_s + SHORTEST_READING_S, doing)
        from_s = run.now_s
        turned_deg = read_turns(run, turn, axis, sensing, doing)
        until_s = run.now_s
        across = {part: bit for part, bit in GYRO_BITS.items() if not part.endswith(turn.gyro)}
        sensing.need_valid(from_s, across)
        need_gyro_follows(turn, sensing, from_s, UP_SENSE * turned_deg / (until_s - from_s))
        table.stop(axis)
        sensing.follow(run.now_s + LATE_OUTPUTS_S, f"{doing}, the table stops")
        sensing.stop()
        while table.is_moving(axis):
            run.clock.sleep(MOVING_LOOK_S)
        facts.update(from_s=from_s, until_s=until_s)


def read_turns(run: Run, turn: Turn, axis: int, sensing: Sensing, doing: str) -> float:
    """Read the table's angle until the turns are whole; returns the angle turned, as it counts.

    Raises ConditionNotReached where they take far longer than they should.
    """
    every_s = turn.reading_interval_s
    wanted_deg = turn.turns * FULL_TURN_DEG + (every_s + EXTRA_S) * abs(turn.rate_deg_per_s)
    gives_up_s = run.now_s + LATE * turn.dwell_s + LATE_S
    first_deg = angle_deg = read_angle(run, turn.unit, axis)
    while abs(angle_deg - first_deg) < wanted_deg:
        left_s = (wanted_deg - abs(angle_deg - first_deg)) / abs(turn.rate_deg_per_s)
        turned = abs(angle_deg - first_deg) / FULL_TURN_DEG
        next_s = run.now_s + min(every_s, max(left_s, SHORTEST_READING_S))
        sensing.follow(next_s, f"{doing}, turn {turned:.1f} of {turn.turns}")
        angle_deg = read_angle(run, turn.unit, axis)
        if run.now_s > gives_up_s:
            raise ConditionNotReached(
                f"{TURNTABLE} has made {turned:.2f} of {turn.turns} turns at "
                f"{turn.rate_deg_per_s:g} deg/s in {LATE * turn.dwell_s + LATE_S:.0f} s; look "
                "whether something holds it"
            )
    return angle_deg - first_deg


def read_angle(run: Run, unit: str, axis: int) -> float:
    """Record what the encoder reads, with the times before and after it was asked for."""
    from station.method.verbs import keep_row
    from station.roles import Turntable

    asked_s = run.now_s
    angle_deg = run.role(TURNTABLE, Turntable).angle_deg(axis)
    keep_row(run, unit, TURNTABLE, TABLE_COLUMNS, angle_deg, asked_s)
    return angle_deg


def need_gyro_follows(turn: Turn, sensing: Sensing, from_s: float, rate_deg_per_s: float) -> None:
    """Raise ConditionNotReached where the gyro that is up does not feel the turns as they are.

    A gyro that saturates is no reason: its samples are left out and flagged.
    """
    gyro, _ = sensing.means(from_s)
    felt = gyro / SECONDS_PER_HOUR
    own = float(felt[AXES.index(turn.gyro)])
    if turn.axis != turn.gyro:
        own = -own  # it points down
    if not own / rate_deg_per_s < FOLLOWS:
        return
    most = AXES[int(np.nanargmax(np.abs(felt)))]
    raise ConditionNotReached(
        f"gyro {turn.gyro} of {IMU} reads {own:.4g} deg/s while {TURNTABLE} turns at "
        f"{rate_deg_per_s:.4g} deg/s (positive: counter-clockwise from above), gyro {most} "
        f"{float(np.nanmax(np.abs(felt))):.4g} deg/s; look how the sensor is mounted, which axis "
        "is up, and which of the table's axes is which in the bench file"
    )


def pose_limits(parameters: NineAxisParameters) -> PoseLimits:
    """Return a plan's limits of the pose check."""
    pose = parameters.pose
    return PoseLimits(pose.acceleration_g, pose.rate_deg_per_h, pose.largest_bias_deg_per_h)
