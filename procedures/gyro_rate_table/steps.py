"""The steps, numbered as the station does it: mount, on, stand, turn, stand, off; again."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from procedures.common.constants import FULL_TURN_DEG
from procedures.common.gyro_source import CABLES, GYRO, NAVIGATOR, Axis, rate_Hz, stop_samples
from procedures.common.sensing import NeedsChanges
from procedures.common.switch_ons import POWER, cool, switch_off, unit_of, warm_up
from station.errors import ConditionNotReached
from station.method.commands import Power
from station.method.duration import Duration, exactly, on_the_way
from station.method.motion import AxisAtRate, AxisTo
from station.method.run import Run
from station.method.verbs import axis_of, come_to_rest, keep_row
from station.procedure import Prompt, Step
from station.roles import Turntable

from .parameters import RateTableParameters, Turn

if TYPE_CHECKING:
    from numpy.typing import NDArray

TURNTABLE = "turntable"
UP_SENSE = -1.0
"""Rates are positive counter-clockwise seen from above, the table's outer axis turns clockwise."""
USUAL_ACCELERATION_DEG_PER_S2 = 50.0
CLOSE_S = 10.0
REACHING_S, MORE_INTERVALS = 3.0, 3
"""Time until a rate or rest is reached beside the ramps; intervals recorded beyond whole turns."""
LATE_SAMPLES_S = 2.0
"""Samples of a record's last moments may still be on their way when it ends."""
LOOK_S = 0.5
LATE, LATE_S = 1.5, 10.0
FOLLOWS = 0.01
TABLE_COLUMNS = {
    "angle_deg": "deg, the encoder of the axis that turns, turns counted, clockwise from above",
    "asked_time_s": "s, run time at which it was asked for",
}

MOUNT = Prompt(
    "mount-gyro-on-table",
    "Mount the gyro on the turntable, its input axis up, along the axis that turns; level the "
    "mounting face to 1 arcmin.",
    checklist=(
        "The gyro is bolted, its cable goes through the slip ring and is free of the axes.",
        "Nobody is within reach of the table.",
    ),
    then="cables; the gyro is switched on by the station and the table moves",
)


def mounting(parameters: RateTableParameters, axis: Axis) -> Prompt:
    """Return what a person does before an axis is measured."""
    if parameters.source == GYRO:
        return MOUNT
    prompt_id, sentence = f"mount-{axis}-up", f"Mount the sensor on the turntable, {axis} up."
    if parameters.source == NAVIGATOR:
        prompt_id = f"navigator-{axis}-up"
        sentence = f"Mount the navigator on the turntable, {axis} up."
    return Prompt(prompt_id, sentence, checklist=MOUNT.checklist, then=MOUNT.then)


def mount(run: Run) -> None:
    """1: the gyro on the table, its cables connected."""
    parameters: RateTableParameters = run.parameters
    run.ask(mounting(parameters, parameters.axes[0]))
    run.ask(CABLES[parameters.source])


def first(run: Run) -> None:
    """2 to 5: on and warm, standing, each rate in both senses, standing."""
    switch_on_and_turn(run, 1, 1, run.parameters.axes[0])


def again(run: Run) -> None:
    """6: off, cool, and the same again."""
    switch_on_and_turn(run, 2, run.parameters.switch_ons, run.parameters.axes[0])


def other_axes(run: Run) -> None:
    """1 to 6 again for each further axis."""
    parameters: RateTableParameters = run.parameters
    for axis in parameters.axes[1:]:
        last = parameters.switch_ons
        if all(run.is_finished(unit_for(axis, number)) for number in range(1, last + 1)):
            continue
        run.apply(Power(POWER, False))
        run.ask(mounting(parameters, axis))
        run.wait(parameters.cool_s, f"{axis}: the gyro cools, switched off")
        switch_on_and_turn(run, 1, last, axis)


STEPS = (
    Step("1", "Mount the gyro on the table, input axis up", mount),
    Step("2", "On, warm; standing, each rate in both senses by whole turns, standing", first),
    Step("6", "Off, cool, and the same again for each switch-on", again),
    Step("6b", "1 to 6 again with each further axis up", other_axes),
    Step("7", "Switch the gyro off", switch_off),
)


def unit_for(axis: Axis, number: int) -> str:
    """Return the name of a unit of work: a switch-on, of an axis where there are several."""
    return unit_of(number) if axis == "IA" else f"{axis} {unit_of(number)}"


def switch_on_and_turn(run: Run, first_number: int, last_number: int, axis: Axis) -> None:
    """Switch the gyro on after it has cooled, let it warm up, and turn it at every rate."""
    parameters: RateTableParameters = run.parameters
    numbers = range(first_number, last_number + 1)
    for number in run.unfinished(numbers, partial(unit_for, axis)):
        unit = unit_for(axis, number)
        cool(run, number)
        make_table_ready(run)
        on_s = warm_up(run, number)
        with run.unit(unit, switch_on=number, on_s=on_s, axis=axis) as facts:
            samples = Samples(run, unit, axis)
            count = len(parameters.turns)
            facts["records"] = [
                record(run, turn, samples, f"{unit}: {turn.words}, {place} of {count}")
                for place, turn in enumerate(parameters.turns, 1)
            ]
            samples.follow(LATE_SAMPLES_S, f"{unit}: the last samples come", every_s=LOOK_S)
        stop_samples(run)


@dataclass
class TableReady:
    """Whether this process of a run has closed the table's servos and levelled its plate."""

    done: bool = False


def make_table_ready(run: Run) -> None:
    """Close the servos of the table's axes, look for unknown zeros, level the plate; once."""
    ready = run.state(TableReady)
    if ready.done:
        return
    parameters: RateTableParameters = run.parameters
    table = run.role(TURNTABLE, Turntable)
    table.programme_limits()
    moves = to_level(parameters)
    turned = (spin(parameters, parameters.turns[1]), *moves)
    each = on_the_way(CLOSE_S / len(turned))
    for move in turned:
        axis = axis_of(run, move)
        if not run.read(partial(table.is_homed, axis), assumed=False):
            table.home(axis)
            doing = "the table looks for its zeros"
            come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S, takes=each)
    for move in moves:
        run.apply(move)
        axis, doing = axis_of(run, move), "the plate is levelled"
        come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S)
    ready.done = True


def to_level(parameters: RateTableParameters) -> tuple[AxisTo, ...]:
    """Return the moves that level the plate of a three-axis table; a person levels another."""
    if parameters.levelled_by != "table":
        return ()
    text = "middle and inner axis to 0 deg"
    return tuple(
        AxisTo(TURNTABLE, axis, text, angle_deg=0.0, decided_by=("parameters", "levelled_by"))
        for axis in ("middle", "inner")
    )


def spin(parameters: RateTableParameters, turn: Turn) -> AxisAtRate:
    """Return the command that lets the vertical axis turn for a record."""
    rate, decides = UP_SENSE * turn.rate_deg_per_s, ("parameters", "rates")
    axis = parameters.table_axis
    return AxisAtRate(TURNTABLE, "outer", turn.words, axis, rate, decided_by=decides)


class Samples(NeedsChanges):
    """The gyro's output of one switch-on, recorded as it comes."""

    def __init__(self, run: Run, unit: str, axis: Axis) -> None:
        self.parameters: RateTableParameters = run.parameters
        self.axis = axis
        super().__init__(run, unit, {self.parameters.source: rate_Hz(self.parameters)})
        self._rows: list[NDArray[Any]] = []

    def take(self) -> dict[str, NDArray[Any]]:
        """Record what has come, and keep it for `rate_deg_per_s`."""
        came = super().take()
        self._rows += came.values()
        return came

    def rate_deg_per_s(self, from_s: float) -> float:
        """Return the gyro's mean rate by the samples that came since a time; NaN without two.

        Those beyond its range do not count.
        """
        import numpy as np

        from procedures.estimation.gyro_outputs import ARRIVAL, outputs_of

        rows = np.concatenate(self._rows) if self._rows else None
        if rows is None or int(np.sum(rows[ARRIVAL] > from_s)) < 2:
            return float("nan")
        own, pulse_arcsec = self.parameters, self.parameters.pulse_weight_arcsec or 0.0
        rows = rows[rows[ARRIVAL] > from_s]
        rates = outputs_of(rows, own.sample_interval_s, [self.axis], pulse_arcsec).rate_deg_per_h
        rates = rates[np.isfinite(rates)]
        return float(np.mean(rates)) / 3600.0 if len(rates) else float("nan")


def record_s(parameters: RateTableParameters, turn: Turn) -> float:
    """Return how long a record lasts: whole turns, and intervals to choose whole ones from."""
    return turn.record_s + MORE_INTERVALS * parameters.sample_interval_s


def recording_s(parameters: RateTableParameters, turn: Turn) -> Duration:
    """Return the bench time of a record, with the ways to the rate and back to rest.

    A record ends with the first reading of the angle after its time.
    """
    every_s = parameters.reading_interval_s
    record = exactly(record_s(parameters, turn)) + Duration(every_s / 2.0, 0.0, every_s)
    if not turn.rate_deg_per_s:
        return record
    ramps_s = 2.0 * abs(turn.rate_deg_per_s) / USUAL_ACCELERATION_DEG_PER_S2
    return record + exactly(parameters.settle_s) + on_the_way(ramps_s + REACHING_S)


def record(run: Run, turn: Turn, samples: Samples, doing: str) -> dict[str, float]:
    """Record the table standing or whole turns at a rate; returns from when to when that is."""
    parameters: RateTableParameters = run.parameters
    command = spin(parameters, turn)
    table, axis = run.role(TURNTABLE, Turntable), axis_of(run, command)

    def act() -> dict[str, float]:
        if turn.rate_deg_per_s:
            spin_up(run, table, axis, samples, doing)
        from_s = run.now_s
        turned_deg = read_turns(run, turn, axis, samples, doing)
        until_s = run.now_s
        if turn.rate_deg_per_s:
            rate = UP_SENSE * turned_deg / (until_s - from_s)
            source = parameters.source
            need_gyro_follows(turn, samples.rate_deg_per_s(from_s), rate, source)
            table.stop(axis)
            while table.is_moving(axis):
                samples.follow(LOOK_S, f"{doing}: the table stops", every_s=LOOK_S)
        return {"rate_deg_per_s": turn.rate_deg_per_s, "from_s": from_s, "until_s": until_s}

    if turn.rate_deg_per_s:
        run.apply(command)
    rates = {**samples.rates, TURNTABLE: 1.0 / parameters.reading_interval_s}
    return run.read(act, {}, recording_s(parameters, turn), rates)


def spin_up(run: Run, table: Turntable, axis: int, samples: Samples, doing: str) -> None:
    """Wait until the table is at its rate, then until the rate has settled."""
    parameters: RateTableParameters = run.parameters
    while not table.is_at_rate(axis):
        samples.follow(LOOK_S, f"{doing}: the table spins up", every_s=LOOK_S)
    settled_s = run.now_s + parameters.settle_s
    while (left_s := settled_s - run.now_s) > 0.0:
        ahead_s = min(parameters.reading_interval_s, left_s)
        samples.follow(ahead_s, f"{doing}: the rate settles", every_s=LOOK_S)
        table.is_at_rate(axis)  # raises where it does not keep it


def read_turns(run: Run, turn: Turn, axis: int, samples: Samples, doing: str) -> float:
    """Read the table's angle until the turns are whole; returns the angle turned in deg.

    Raises ConditionNotReached where they take far longer than they should.
    """
    parameters: RateTableParameters = run.parameters
    from_s, wanted_s = run.now_s, record_s(parameters, turn)
    wanted_deg = abs(turn.rate_deg_per_s) * wanted_s
    first_deg = angle_deg = read_angle(run, samples.unit, axis)
    while run.now_s < from_s + wanted_s or abs(angle_deg - first_deg) < wanted_deg:
        turned = abs(angle_deg - first_deg) / FULL_TURN_DEG
        every_s = parameters.reading_interval_s
        samples.follow(every_s, f"{doing}: turn {turned:.1f}", every_s=LOOK_S)
        angle_deg = read_angle(run, samples.unit, axis)
        if run.now_s > from_s + LATE * wanted_s + LATE_S:
            raise ConditionNotReached(
                f"{TURNTABLE} has made {turned:.2f} turns at {turn.rate_deg_per_s:g} deg/s in "
                f"{run.now_s - from_s:.0f} s; look whether something holds it"
            )
    return angle_deg - first_deg


def read_angle(run: Run, unit: str, axis: int) -> float:
    """Record what the encoder reads, with the times before and after it was asked for."""
    asked_s = run.now_s
    angle_deg = run.role(TURNTABLE, Turntable).angle_deg(axis)
    keep_row(run, unit, TURNTABLE, TABLE_COLUMNS, angle_deg, asked_s)
    return angle_deg


def need_gyro_follows(
    turn: Turn, read_deg_per_s: float, rate_deg_per_s: float, source: str = GYRO
) -> None:
    """Raise ConditionNotReached where the gyro does not feel the turns, or the other way round.

    A gyro that saturates is no reason: its record is left out and flagged.
    """
    if not read_deg_per_s / rate_deg_per_s < FOLLOWS:
        return
    raise ConditionNotReached(
        f"{source} counts {read_deg_per_s:.4g} deg/s while {TURNTABLE} turns at "
        f"{rate_deg_per_s:.4g} deg/s (positive: counter-clockwise from above); look whether the "
        "gyro's input axis points up and which of the table's axes is which in the bench file"
    )
