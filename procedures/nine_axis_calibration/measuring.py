"""One unit of work: a position or a further pose at rest, judged; or whole turns at one rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.gyro_source import IMU
from procedures.common.sensing import ACCELEROMETERS, GYROS, NeedsChanges
from station.errors import ConditionNotReached, InstrumentError
from station.method.duration import Duration, exactly, on_the_way
from station.method.motion import AxisAtRate
from station.method.run import NO_ROWS
from station.method.set_points import Bounded
from station.method.verbs import axis_of, come_to_rest, keep_row, look_until
from station.roles import Imu, Turntable

from .directions import AXES, PoseLimits, up_of
from .parameters import (
    MAX_READING_S,
    SHORTEST_READING_S,
    NineAxisParameters,
    Turn,
    pose_unit,
)
from .placing import MOVE_S, RATES, STANDS, TURNTABLE, Stand, in_pose, in_position, place

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.method.run import Rates, Run

    from .dataset import Array

UP_SENSE = -1.0
"""Rates are positive counter-clockwise seen from above, the table's outer axis turns clockwise."""
USUAL_ACCELERATION_DEG_PER_S2, SETTLING_S = 50.0, 3.0
EXTRA_S = 0.1
"""So much more than the whole turns is recorded, and a reading more."""
LATE_OUTPUTS_S = 0.2
"""Outputs of a record's last moments may still be on their way when it ends."""
SIGMAS = 3.0
"""So many of its prior a direction between axes may be off."""

LOOK_S = 2.0
"""Run time between two looks; less where time runs by itself, so that a kill loses little."""
MOSTLY = 0.5
GYRO_BITS = {"gyro X": 0, "gyro Y": 1, "gyro Z": 2}
ACCELEROMETER_BITS = {"accelerometer X": 4, "accelerometer Y": 5, "accelerometer Z": 6}
"""Bits of an output's status that are set while a part is not valid."""
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


class Sensing(NeedsChanges):
    """The sensor's stream for one unit of work; `stop` it when the unit is done.

    `beside` are other sources that are recorded with it, as `rates` has them.
    """

    def __init__(self, run: Run, unit: str, beside: Rates = NO_ROWS) -> None:
        self.rate_Hz = run.parameters.sample_rate_Hz
        super().__init__(run, unit, {IMU: self.rate_Hz, **beside})
        self._sensor = run.role(IMU, Imu)
        self._sensor.start(self.rate_Hz)
        self._rows: list[NDArray[Any]] = []

    def follow_to(self, until_s: float, doing: str) -> None:
        """Record until a run time; raises InstrumentError for a sensor that is silent or frozen."""
        act = partial(look_until, self._run, until_s, self.take, doing, LOOK_S)
        lasts_s = max(until_s - self._run.now_s, 0.0)
        self._run.read(act, takes=exactly(lasts_s), rates=self.rates)

    def take(self) -> dict[str, NDArray[Any]]:
        """Record what has come."""
        came = super().take()
        if IMU in came:
            self._rows.append(came[IMU])
        return came

    def means(self, from_s: float) -> tuple[Array, Array]:
        """Return the gyros' means in deg/h and the accelerometers' in g, (3,) each, since a time.

        NaN where nothing came.
        """
        import numpy as np

        rows = self._since(from_s)
        if not len(rows):
            return np.full(3, np.nan), np.full(3, np.nan)
        gyro, force = (
            np.array([np.nanmean(rows[name]) for name in names])
            for names in (GYROS, ACCELEROMETERS)
        )
        return gyro * SECONDS_PER_HOUR, force

    def _since(self, from_s: float) -> NDArray[Any]:
        """Return the outputs that came since a time."""
        import numpy as np

        from station.roles.base import ARRIVAL

        rows = np.concatenate(self._rows) if self._rows else np.zeros(0, [(ARRIVAL, float)])
        return np.asarray(rows[rows[ARRIVAL] > from_s])

    def need_valid(self, from_s: float, parts: Mapping[str, int]) -> None:
        """Raise InstrumentError for a part, given with its status bit, that mostly is not valid.

        Of the outputs since a time. For parts that nothing drives beyond their range now.
        """
        rows = self._since(from_s)
        if not len(rows):
            raise InstrumentError(
                IMU,
                f"record {self.unit}",
                "no output came during the whole record",
                "check its cable and its power",
            )
        for part, bit in parts.items():
            share = float((rows["status"].astype(int) >> bit & 1).mean())
            if share > MOSTLY:
                raise InstrumentError(
                    IMU,
                    f"record {self.unit}",
                    f"its outputs say that {part} is not valid, {share:.0%} of them, and nothing "
                    "drives it beyond its range",
                    "switch it off and on; where it says the same again have it looked at",
                )

    def stop(self) -> None:
        """End the output and record the rest of it."""
        self._sensor.stop()
        self._run.read(self.take)


def need_sensor_well(run: Run) -> None:
    """Raise InstrumentError where the sensor says of itself that something is wrong."""
    sensor = run.role(IMU, Imu)

    def look() -> None:
        if faults := sensor.status().faults:
            raise InstrumentError(
                IMU,
                "asked for its status",
                f"it reports {', '.join(faults)}",
                "switch it off and on; where it reports the same again have it looked at",
            )

    run.read(look)


Judge = Callable[["Array", "Array"], str]
"""Says why a stand is wrong by the means of the gyros in deg/h and of the accelerometers in g, (3,)
each; nothing where it is right."""


@dataclass(frozen=True)
class AtRest:
    """What is measured at rest in one unit of work, and whether the analysis may refuse it."""

    target: Stand
    lasts_s: float
    judge: Judge
    facts: Mapping[str, object]
    declared: str
    doing: str
    may_stay_wrong: bool


def stands_of(parameters: NineAxisParameters) -> dict[str, AtRest]:
    """Return what a plan measures at rest, by the names of the units of work, in their order."""
    stands = {}
    for n, position in enumerate(parameters.all_positions, start=1):
        target, judge = in_position(position), partial(judge_position, parameters, position)
        declared = f"{target.words}, {STANDS[position]}: record"
        doing = f"{target.words}, {n} of {len(parameters.all_positions)}"
        facts: dict[str, object] = {"position": position}
        stands[target.words] = AtRest(
            target, parameters.static_time_s, judge, facts, declared, doing, may_stay_wrong=True
        )
    for n, word in enumerate(parameters.poses, start=1):
        target, judge = in_pose(word), partial(judge_direction, parameters, word)
        doing = f"{target.words}, {n} of {len(parameters.poses)}"
        declared = f"{target.words}: record"
        stands[pose_unit(word)] = AtRest(
            target, parameters.pose_time_s, judge, {"pose": word}, declared, doing, False
        )
    return stands


def measure_at_rest(run: Run, unit: str, rest: AtRest) -> None:
    """Measure one stand; a wrong one is measured again.

    A position that stays wrong is refused by the analysis, another direction ends the run.
    """
    attempts = run.parameters.pose.attempts
    with run.unit(unit, **rest.facts) as facts:
        for attempt in range(1, attempts + 1):
            place(run, rest.target, again=attempt > 1)
            run.declare(Bounded(IMU, rest.declared))
            last = attempt == attempts
            from_s, until_s, why = record_at_rest(run, unit, rest, whole=last)
            if not why:
                break
            run.event("pose-refused", unit=unit, attempt=attempt, why=why)
            ends = "the record counts as of a wrong position" if rest.may_stay_wrong else "it ends"
            run.say(f"    {unit}: {why}; {ends if last else 'it is measured again'}")
        if why and not rest.may_stay_wrong:
            raise ConditionNotReached(
                f"the sensor is to stand with {rest.target.words}; {why}. Look how it stands, "
                "and which of its axes is which"
            )
        facts.update(from_s=from_s, until_s=until_s, attempts=attempt)
        if rest.may_stay_wrong:
            facts.update(right=not why)


def record_at_rest(run: Run, unit: str, rest: AtRest, *, whole: bool) -> tuple[float, float, str]:
    """Record a stand and judge it; returns begin and end of what counts, and what is wrong.

    One that is wrong from the beginning ends the record at once, unless it is to be `whole` and
    the analysis decides, with the biases free.
    """
    parameters: NineAxisParameters = run.parameters
    sensing, lasts_s = Sensing(run, unit), rest.lasts_s
    sensing.follow_to(run.now_s + parameters.static_settle_s, f"{rest.doing}, it comes to rest")
    from_s = run.now_s

    def look_twice() -> str:
        for until_s in (from_s + min(FIRST_LOOK_S, lasts_s), from_s + lasts_s):
            sensing.follow_to(until_s, rest.doing)
            sensing.need_valid(from_s, {**GYRO_BITS, **ACCELEROMETER_BITS})
            why = rest.judge(*sensing.means(from_s))
            if why and not (whole and rest.may_stay_wrong):
                break
        return why

    # A wrong stand is measured again.
    way_s = on_the_way(MOVE_S).longest_s if parameters.positioning == "table" else 0.0
    once_more_s = way_s + parameters.static_settle_s + lasts_s + LATE_OUTPUTS_S
    again = Duration(0.0, 0.0, (parameters.pose.attempts - 1) * once_more_s)
    why = run.read(look_twice, "", exactly(lasts_s) + again, sensing.rates)
    until_s = run.now_s
    sensing.follow_to(run.now_s + LATE_OUTPUTS_S, rest.doing)
    sensing.stop()
    return from_s, until_s, why


def judge_position(
    parameters: NineAxisParameters, position: int, gyro_deg_per_h: Array, acceleration_g: Array
) -> str:
    """Return why a position is wrong."""
    from .pose import check_pose

    limits = pose_limits(parameters)
    latitude_deg = parameters.latitude_deg
    pose = check_pose(position, gyro_deg_per_h, acceleration_g, latitude_deg, limits)
    return "" if pose.right else pose.seems


def judge_direction(
    parameters: NineAxisParameters, word: str, gyro_deg_per_h: Array, acceleration_g: Array
) -> str:
    """Return why a direction does not point up as well as it should."""
    import numpy as np

    up = up_of(word)
    assert up is not None
    edge_g = SIGMAS * math.radians(parameters.prior.edge_deg) if max(map(abs, up)) < 1.0 else 0.0
    off_g = float(np.max(np.abs(acceleration_g - np.array(up))))
    if off_g <= parameters.pose.acceleration_g + edge_g:
        return ""
    felt = ", ".join(f"{value:+.2f}" for value in acceleration_g)
    return f"the accelerometers read {felt} g, {off_g:.3g} g off"


def turn(run: Run, turn: Turn, doing: str) -> None:
    """Record whole turns at one rate in one sense, spin-up and settling left out."""
    parameters: NineAxisParameters = run.parameters
    command = AxisAtRate(
        TURNTABLE,
        "outer",
        f"{turn.unit}: {turn.turns} turn{'s' if turn.turns > 1 else ''}",
        parameters.table_axis,
        UP_SENSE * turn.rate_deg_per_s,
        decided_by=RATES,
    )
    table, axis = run.role(TURNTABLE, Turntable), axis_of(run, command)
    # To the rate, and from it to rest again.
    way = on_the_way(abs(turn.rate_deg_per_s) / USUAL_ACCELERATION_DEG_PER_S2 + SETTLING_S / 2.0)
    with run.unit(
        turn.unit, axis=turn.axis, rate_deg_per_s=turn.rate_deg_per_s, turns=turn.turns
    ) as facts:
        sensing = Sensing(run, turn.unit)
        run.apply(command)
        settling = partial(spin_up, run, table, axis, sensing, doing)
        run.read(settling, takes=way + exactly(parameters.settle_s), rates=sensing.rates)
        # The line is then free for the first reading as it is for all others.
        sensing.follow_to(run.now_s + SHORTEST_READING_S, doing)
        from_s = run.now_s
        turned_deg = run.read(
            partial(read_turns, run, turn, axis, sensing, doing),
            0.0,
            exactly(turn.dwell_s + turn.reading_interval_s + EXTRA_S),
            {**sensing.rates, TURNTABLE: 1.0 / turn.reading_interval_s},
        )
        until_s = run.now_s
        run.read(lambda: need_gyro_follows(turn, sensing, from_s, turned_deg / (until_s - from_s)))
        table.stop(axis)
        stops = f"{doing}, the table stops"
        sensing.follow_to(run.now_s + LATE_OUTPUTS_S, stops)
        sensing.stop()
        come_to_rest(run, TURNTABLE, stops, axis=axis, every_s=MOVING_LOOK_S, takes=way)
        facts.update(from_s=from_s, until_s=until_s)


def spin_up(run: Run, table: Turntable, axis: int, sensing: Sensing, doing: str) -> None:
    """Wait until the table is at its rate, then until the rate has settled."""
    while not table.is_at_rate(axis):
        sensing.follow_to(run.now_s + MOVING_LOOK_S, f"{doing}, the table spins up")
    settled_s = run.now_s + run.parameters.settle_s
    while run.now_s < settled_s:
        sensing.follow_to(min(run.now_s + MAX_READING_S, settled_s), f"{doing}, the rate settles")
        table.is_at_rate(axis)  # raises where it does not keep it


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
        sensing.follow_to(next_s, f"{doing}, turn {turned:.1f} of {turn.turns}")
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
    asked_s = run.now_s
    angle_deg = run.role(TURNTABLE, Turntable).angle_deg(axis)
    keep_row(run, unit, TURNTABLE, TABLE_COLUMNS, angle_deg, asked_s)
    return angle_deg


def need_gyro_follows(turn: Turn, sensing: Sensing, from_s: float, turned_deg_per_s: float) -> None:
    """Raise InstrumentError or ConditionNotReached where the gyros do not feel the turns as such.

    A gyro that saturates is no reason: its samples are left out and flagged.
    """
    import numpy as np

    across = {part: bit for part, bit in GYRO_BITS.items() if not part.endswith(turn.gyro)}
    sensing.need_valid(from_s, across)
    rate_deg_per_s = UP_SENSE * turned_deg_per_s
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
