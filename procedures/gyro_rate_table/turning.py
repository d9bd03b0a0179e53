"""One switch-on: the table ready, the gyro standing, then turned at each rate in both senses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.pulses import pulses_of
from station.errors import ConditionNotReached
from station.method.commands import Power
from station.runner.verbs import Follower, come_to_rest, keep_row, look_until

from .parameters import FULL_TURN_DEG, RateTableParameters, Turn, unit_of
from .work import (
    GYRO,
    LATE_SAMPLES_S,
    POWER,
    TURNTABLE,
    UP_SENSE,
    record_s,
    sampling,
    spin,
    to_level,
)

if TYPE_CHECKING:
    from station.runner.run import Run

LOOK_S = 0.5
LATE, LATE_S = 1.5, 10.0
FOLLOWS = 0.01
TABLE_COLUMNS = {
    "angle_deg": "deg, the encoder of the axis that turns, turns counted, clockwise from above",
    "asked_time_s": "s, run time at which it was asked for",
}


@dataclass
class TableReady:
    """Whether this process of a run has closed the table's servos and levelled its plate."""

    done: bool = False


def make_table_ready(run: Run) -> None:
    """Close the servos of the table's axes, look for unknown zeros, level the plate; once."""
    from station.roles import Turntable

    ready = run.state(TableReady)
    if ready.done:
        return
    parameters: RateTableParameters = run.parameters
    table = run.role(TURNTABLE, Turntable)
    table.programme_limits()
    moves = to_level(parameters)
    vertical = spin(parameters, parameters.turns[1]).axis_number(run.bench)
    for axis in (vertical, *(move.axis_number(run.bench) for move in moves)):
        if not table.is_homed(axis):
            table.home(axis)
            doing = "the table looks for its zeros"
            come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S)
    for move in moves:
        run.apply(move)
        number = move.axis_number(run.bench)
        come_to_rest(run, TURNTABLE, "the plate is levelled", axis=number, every_s=LOOK_S)
    ready.done = True


def switch_on_and_turn(run: Run, number: int) -> None:
    """Switch the gyro on after it has cooled, let it warm up, and turn it at every rate."""
    from station.roles import GyroAcquisition

    parameters: RateTableParameters = run.parameters
    unit = unit_of(number)
    if run.is_finished(unit):
        run.progress.say(f"    {unit}: measured before the run was interrupted")
        return
    run.may_pause()
    if number > 1:
        run.apply(Power(POWER, False))
        run.wait(parameters.cool_s, f"{unit}: the gyro cools, switched off")
    make_table_ready(run)
    run.apply(Power(POWER, True))
    on_s = run.clock.now()
    run.wait(parameters.warm_up_s, f"{unit}: the gyro warms up")
    run.apply(sampling(parameters))
    board = run.role(GYRO, GyroAcquisition)
    with run.unit(unit, switch_on=number, on_s=on_s) as facts:
        pulses = Pulses(run, unit, Follower(run, {GYRO: board}))
        count = len(parameters.turns)
        facts["records"] = [
            record(run, turn, unit, pulses, f"{unit}: {turn.words}, {place} of {count}")
            for place, turn in enumerate(parameters.turns, 1)
        ]
        pulses.follow(run.clock.now() + LATE_SAMPLES_S, f"{unit}: the last samples come")
    board.stop()


class Pulses:
    """The gyro's counts of one switch-on, recorded as they come."""

    def __init__(self, run: Run, unit: str, follower: Follower) -> None:
        self._run, self._unit, self._follower = run, unit, follower
        self._rows: list[NDArray[Any]] = []

    def follow(self, until_s: float, doing: str) -> None:
        """Record until a run time; InstrumentError for a board that is silent."""
        look_until(self._run, until_s, self.look, doing, LOOK_S)

    def look(self) -> None:
        """Record what has come."""
        rows = self._follower.take(self._unit).get(GYRO)
        if rows is not None:
            self._rows.append(rows)

    def rate_deg_per_s(self, from_s: float) -> float:
        """Return the gyro's mean rate by the samples that came since a time; NaN without two."""
        from station.record.raw import ARRIVAL

        parameters: RateTableParameters = self._run.parameters
        rows = np.concatenate(self._rows) if self._rows else None
        if rows is None or int(np.sum(rows[ARRIVAL] > from_s)) < 2:
            return float("nan")
        counts = pulses_of(rows["counts"][rows[ARRIVAL] > from_s])
        arcsec = float(np.mean(counts)) * parameters.pulse_weight_arcsec
        return arcsec / 3600.0 / parameters.sample_interval_s


def record(run: Run, turn: Turn, unit: str, pulses: Pulses, doing: str) -> dict[str, float]:
    """Record the table standing or whole turns at a rate; returns from when to when that is."""
    from station.roles import Turntable

    parameters: RateTableParameters = run.parameters
    command = spin(parameters, turn)
    table, axis = run.role(TURNTABLE, Turntable), command.axis_number(run.bench)
    if turn.rate_deg_per_s:
        run.apply(command)
        while not table.is_at_rate(axis):
            pulses.follow(run.clock.now() + LOOK_S, f"{doing}: the table spins up")
        settled_s = run.clock.now() + parameters.settle_s
        while run.clock.now() < settled_s:
            ahead_s = min(run.clock.now() + parameters.reading_interval_s, settled_s)
            pulses.follow(ahead_s, f"{doing}: the rate settles")
            table.is_at_rate(axis)  # raises where it does not keep it
    from_s = run.clock.now()
    first_deg = angle_deg = read_angle(run, unit, axis)
    last_s = from_s + record_s(parameters, turn)
    wanted_deg = abs(turn.rate_deg_per_s) * record_s(parameters, turn)
    gives_up_s = from_s + LATE * record_s(parameters, turn) + LATE_S
    while run.clock.now() < last_s or abs(angle_deg - first_deg) < wanted_deg:
        turned = abs(angle_deg - first_deg) / FULL_TURN_DEG
        pulses.follow(
            run.clock.now() + parameters.reading_interval_s, f"{doing}: turn {turned:.1f}"
        )
        angle_deg = read_angle(run, unit, axis)
        if run.clock.now() > gives_up_s:
            raise ConditionNotReached(
                f"{TURNTABLE} has made {turned:.2f} turns at {turn.rate_deg_per_s:g} deg/s in "
                f"{run.clock.now() - from_s:.0f} s; look whether something holds it"
            )
    until_s = run.clock.now()
    if turn.rate_deg_per_s:
        rate = UP_SENSE * (angle_deg - first_deg) / (until_s - from_s)
        need_gyro_follows(turn, pulses.rate_deg_per_s(from_s), rate)
        table.stop(axis)
        while table.is_moving(axis):
            pulses.follow(run.clock.now() + LOOK_S, f"{doing}: the table stops")
    return {"rate_deg_per_s": turn.rate_deg_per_s, "from_s": from_s, "until_s": until_s}


def read_angle(run: Run, unit: str, axis: int) -> float:
    """Record what the encoder reads, with the times before and after it was asked for."""
    from station.roles import Turntable

    asked_s = run.clock.now()
    angle_deg = run.role(TURNTABLE, Turntable).angle_deg(axis)
    keep_row(run, unit, TURNTABLE, TABLE_COLUMNS, angle_deg, asked_s)
    return angle_deg


def need_gyro_follows(turn: Turn, read_deg_per_s: float, rate_deg_per_s: float) -> None:
    """Raise ConditionNotReached where the gyro does not feel the turns, or the other way round.

    A gyro that saturates is no reason: its record is left out and flagged.
    """
    if not read_deg_per_s / rate_deg_per_s < FOLLOWS:
        return
    raise ConditionNotReached(
        f"{GYRO} counts {read_deg_per_s:.4g} deg/s while {TURNTABLE} turns at "
        f"{rate_deg_per_s:.4g} deg/s (positive: counter-clockwise from above); look whether the "
        "gyro's input axis points up and which of the table's axes is which in the bench file"
    )
