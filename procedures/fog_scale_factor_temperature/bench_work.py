"""Chamber, table and navigator as one run uses them: follow, soak, turn an axis up, turn around."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from station.errors import ConditionNotReached, InstrumentError, StationError
from station.roles.turntable import table_axes

from .check import CHAMBER, NAVIGATOR, TABLE
from .dataset import AXES, FULL_TURN_DEG
from .parameters import FogParameters

if TYPE_CHECKING:
    from station.runner.run import Run

WORK = "the bench"
LOOK_S = 8.0
"""Run time between two looks; less where time runs by itself, so that a kill loses little. A run
that ends early takes first what has come since the last one."""
MOVING_LOOK_S = 1.0
TURNING_LOOK_S = 2.0
CHAMBER_EVERY_S = 30.0
SILENT_AFTER_S = 10.0
SETTLED_S = 1.0
ARRIVES_WITHIN_S = 0.4
"""Outputs are late: of a rest count those after the first of these and before the second."""
SHORT_OF_TURN_S = 1.0
"""The axis goes to its angle when it is so near to it: it brakes, then covers the rest."""
SOAK, WARM_UP, RANDOM = "soak", "warm-up", "random-rotation"
RAMP, COOLING, PROOF = "ramp", "cooling", "proof"
BETWEEN_TURNS = (SOAK, WARM_UP, RANDOM, RAMP, COOLING, PROOF)
"""Names under which is recorded what belongs to no turn; a turn's begins with RAMP or PROOF."""

UP: dict[str, tuple[float, float]] = {"x": (90.0, 0.0), "y": (0.0, -90.0), "z": (0.0, 180.0)}
"""Angles of the middle and the inner axis, in deg, that let a body axis point up (z is down)."""
CHAMBER_COLUMNS = {
    "process_value_degC": "degC, the chamber's air",
    "set_point_degC": "degC, what it is controlled to",
}


class BenchWork:
    """The instruments of this procedure; what they say goes to the record all the time."""

    def __init__(self, run: Run) -> None:
        from station.roles import Navigator, ThermalChamber, Turntable

        self.run = run
        self.parameters: FogParameters = run.parameters
        self.chamber = run.role(CHAMBER, ThermalChamber)
        self.table = run.role(TABLE, Turntable)
        self.navigator = run.role(NAVIGATOR, Navigator)
        axes = table_axes(run.bench.instruments[TABLE].settings)
        assert axes is not None  # `check` asks for them
        self.axes = axes
        self.newest: Any = None
        """The navigator's last row, a structured array of shape (1,); None before the first."""
        self.navigates = False
        self._unit = ""
        self._chamber_due_s = self._due_s = self._heard_s = run.clock.now()

    def look(self, unit: str) -> None:
        """Record what has come, where it is time to; what came before belongs to the unit before.

        The chamber's ramp is stepped by this where its driver does that.
        """
        from station.record.raw import ARRIVAL

        now_s = self.run.clock.now()
        if now_s >= self._due_s:
            self.take(unit)
        if now_s >= self._chamber_due_s:
            self._chamber_due_s = now_s + CHAMBER_EVERY_S
            names = [(name, np.float64) for name in (*CHAMBER_COLUMNS, ARRIVAL)]
            values = (self.chamber.temperature_degC(), self.chamber.set_point_degC(), now_s)
            self.run.record.block(CHAMBER, unit, CHAMBER_COLUMNS, np.array([values], dtype=names))

    def take(self, unit: str) -> None:
        """Record the navigator's outputs that have come.

        Raises InstrumentError when none has for long.
        """
        from station.record.raw import ARRIVAL
        from station.runner.verbs import to_rows

        clock = self.run.clock
        self._due_s = clock.now() + clock.holding_s(LOOK_S)
        if not self.navigates:
            return
        rows = to_rows(self.navigator.drain())
        if len(rows):
            self.run.record.block(self.navigator.source, unit, self.navigator.columns, rows)
            self.newest, self._heard_s = rows[-1:], float(rows[ARRIVAL][-1])
        elif clock.now() - self._heard_s > SILENT_AFTER_S:
            raise InstrumentError(
                NAVIGATOR,
                f"record {unit}",
                f"no output came for {SILENT_AFTER_S:g} s",
                "check its cable and its power",
            )

    @contextmanager
    def keeps_what_came(self) -> Iterator[None]:
        """Record, where a step ends with an error, what had come before it."""
        try:
            yield
        except BaseException:
            with suppress(StationError, OSError):
                self.take(self._unit)
            raise

    def follow(self, until_s: float, unit: str, said: str = "") -> None:
        """Record until a run time."""
        clock = self.run.clock
        if unit != self._unit:
            self.take(self._unit)
            self._unit = unit
        while clock.now() < until_s:
            clock.sleep_until(min(clock.now() + clock.holding_s(LOOK_S), until_s))
            self.look(unit)
            self.run.say_progress(said)

    def follow_until(
        self, reached: Callable[[], bool], at_most_s: float, unit: str, said: Callable[[], str]
    ) -> bool:
        """Record until something is reached; False where it was not within `at_most_s`."""
        until_s = self.run.clock.now() + at_most_s
        while not reached():
            if self.run.clock.now() >= until_s:
                return False
            self.follow(self.run.clock.now() + LOOK_S, unit, said())
        return True

    def gyro_degC(self) -> NDArray[np.float64]:
        """Return the last temperatures of the three gyros (3,), NaN before any were heard."""
        if self.newest is None:
            return np.full(3, np.nan)
        return np.array([float(self.newest[f"temperature_{axis}_degC"][0]) for axis in AXES])

    def start_navigator(self) -> None:
        """Let the navigator output for the rest of the run."""
        self.navigator.start(self.parameters.navigator_rate_Hz)
        self.navigates = True
        self._heard_s = self.run.clock.now()

    def reach(self, temperature_degC: float, unit: str) -> None:
        """Bring the chamber's air to a temperature as fast as it can.

        Raises ConditionNotReached where it does not come there in the plan's time.
        """
        self.chamber.set_temperature(temperature_degC)
        within = self.parameters.soaked_within_degC
        there = self.follow_until(
            lambda: abs(self.chamber.temperature_degC() - temperature_degC) <= within,
            self.parameters.chamber_at_most_s,
            unit,
            lambda: f"the chamber goes to {temperature_degC:g} degC",
        )
        if not there:
            raise ConditionNotReached(
                f"{CHAMBER} did not come to {temperature_degC:g} degC within "
                f"{self.parameters.chamber_at_most_s / 3600:.3g} h, it stands at "
                f"{self.chamber.temperature_degC():.1f} degC; look at its door, its alarms and its "
                "load"
            )

    def go_to(self, axis: int, angle_deg: float, unit: str, said: str) -> None:
        """Turn one table axis to an angle and wait until it rests there."""
        self.table.move_to(axis, angle_deg)
        while self.table.is_moving(axis):
            self.follow(self.run.clock.now() + MOVING_LOOK_S, unit, said)

    def turn_to(self, axis: int, angle_deg: float, unit: str, said: str) -> None:
        """Turn one table axis to an angle at the plan's rate and wait until it rests there."""
        rate = self.parameters.turn_rate_deg_per_s
        left_deg = angle_deg - self.table.angle_deg(axis)
        self.table.turn(axis, math.copysign(rate, left_deg))
        ends_s = self.run.clock.now() + abs(left_deg) / rate - SHORT_OF_TURN_S
        while self.run.clock.now() < ends_s:
            self.follow(min(self.run.clock.now() + TURNING_LOOK_S, ends_s), unit, said)
            self.table.is_at_rate(axis)  # raises where it does not keep it
        self.go_to(axis, angle_deg, unit, said)

    def put_up(self, axis: str, unit: str) -> None:
        """Turn the table until a body axis points up."""
        middle_deg, inner_deg = UP[axis]
        self.go_to(self.axes.middle, middle_deg, unit, f"{axis} is turned up")
        self.go_to(self.axes.inner, inner_deg, unit, f"{axis} is turned up")

    def rest(self, unit: str, said: str) -> None:
        """Stand for the plan's time to settle, and until an output told the attitude at rest.

        Raises InstrumentError where none comes any more.
        """
        from station.record.raw import ARRIVAL

        clock = self.run.clock
        rests_s = clock.now() + SETTLED_S
        self.follow(clock.now() + self.parameters.settle_s, unit, said)
        self.take(unit)
        while self.newest is None or self.newest[ARRIVAL][0] < rests_s:
            self.follow(clock.now() + MOVING_LOOK_S, unit, said)
            self.take(unit)
        # An output that is read right before the next movement is not taken for one at rest.
        self.follow(float(self.newest[ARRIVAL][0]) + ARRIVES_WITHIN_S, unit, said)
        self.take(unit)

    def turn_around(self, unit: str, sign: int, said: str) -> tuple[float, float, float, float]:
        """Turn the vertical axis once, at rest before and after.

        Returns the run times of the end of the first rest, of both ends of the second, and the
        angle that the encoder turned in deg.
        """
        outer = self.axes.outer
        self.rest(unit, said)
        before_s, before_deg = self.run.clock.now(), self.table.angle_deg(outer)
        self.turn_to(outer, before_deg + sign * FULL_TURN_DEG, unit, said)
        rests_s = self.run.clock.now()
        self.rest(unit, said)
        turned_deg = self.table.angle_deg(outer) - before_deg
        return before_s, rests_s, self.run.clock.now(), turned_deg


def work_of(run: Run) -> BenchWork:
    """Return the bench as this process of the run uses it."""
    if WORK not in run.handed_on:
        run.handed_on[WORK] = BenchWork(run)
    work: BenchWork = run.handed_on[WORK]
    return work
