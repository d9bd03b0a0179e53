"""Chamber, table and navigator as one run uses them: follow, soak, turn an axis up, turn around."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from station.errors import ConditionNotReached, StationError
from station.method.motion import AxisAtRate, AxisBy, AxisCommand, TemperatureTo
from station.method.verbs import Follower, look_until
from station.roles.turntable import table_axes

from .parameters import AXES, FogParameters
from .work import CHAMBER, CHAMBER_EVERY_S, LOOK_S, NAVIGATOR, TABLE

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.method.run import Run

MOVING_LOOK_S = 1.0
TURNING_LOOK_S = 2.0
SETTLED_S = 1.0
ARRIVES_WITHIN_S = 0.4
"""Outputs are late: of a rest count those after the first of these and before the second."""
SHORT_OF_TURN_S = 1.0
"""The axis goes to its angle when it is so near to it: it brakes, then covers the rest."""
SOAK, WARM_UP, RANDOM = "soak", "warm-up", "random-rotation"
RAMP, COOLING, PROOF = "ramp", "cooling", "proof"
BETWEEN_TURNS = (SOAK, WARM_UP, RANDOM, RAMP, COOLING, PROOF)
"""Names under which is recorded what belongs to no turn; a turn's begins with RAMP or PROOF."""

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
        self._follower: Follower | None = None
        """Of the navigator's outputs, None where it gives none."""
        self._unit = ""
        self._chamber_due_s = self._due_s = run.now_s

    @property
    def newest(self) -> Any:
        """The navigator's last row, a structured array of shape (1,); None before the first."""
        return None if self._follower is None else self._follower.newest.get(NAVIGATOR)

    def look(self, unit: str) -> None:
        """Record what has come, where it is time to; what came before belongs to the unit before.

        The chamber's ramp is stepped by this where its driver does that.
        """
        from station.roles.base import ARRIVAL

        now_s = self.run.now_s
        if now_s >= self._due_s:
            self.take(unit)
        if now_s >= self._chamber_due_s:
            self._chamber_due_s = now_s + CHAMBER_EVERY_S
            import numpy as np

            names = [(name, np.float64) for name in (*CHAMBER_COLUMNS, ARRIVAL)]
            values = (self.chamber.temperature_degC(), self.chamber.set_point_degC(), now_s)
            self.run.keep_rows(CHAMBER, unit, CHAMBER_COLUMNS, np.array([values], dtype=names))

    def take(self, unit: str) -> None:
        """Record the navigator's outputs that have come.

        Raises InstrumentError when none has for long.
        """
        clock = self.run.clock
        self._due_s = clock.now() + clock.holding_s(LOOK_S)
        if self._follower is not None:
            self._follower.take(unit)

    @contextmanager
    def keeps_what_came(self) -> Iterator[None]:
        """Record, where a step ends with an error, what had come before it."""
        try:
            yield
        except BaseException:
            with suppress(StationError, OSError):
                self.take(self._unit)
            raise

    def follow(self, until_s: float, unit: str, doing: str = "") -> None:
        """Record until a run time."""
        if unit != self._unit:
            self.take(self._unit)
            self._unit = unit
        look_until(self.run, until_s, lambda: self.look(unit), doing, LOOK_S)

    def follow_until(
        self, reached: Callable[[], bool], at_most_s: float, unit: str, doing: Callable[[], str]
    ) -> bool:
        """Record until something is reached; False where it was not within `at_most_s`."""
        until_s = self.run.now_s + at_most_s
        while not reached():
            if self.run.now_s >= until_s:
                return False
            self.follow(self.run.now_s + LOOK_S, unit, doing())
        return True

    def gyro_degC(self) -> NDArray[np.float64]:
        """Return the last temperatures of the three gyros (3,), NaN before any were heard."""
        import numpy as np

        if self.newest is None:
            return np.full(3, np.nan)
        return np.array([float(self.newest[f"temperature_{axis}_degC"][0]) for axis in AXES])

    def start_navigator(self) -> None:
        """Let the navigator output for the rest of the run."""
        self.navigator.start(self.parameters.navigator_rate_Hz)
        self._follower = Follower(self.run, {NAVIGATOR: self.navigator})

    def stop_navigator(self) -> None:
        """End the outputs; what is still on its way is left there."""
        self._follower = None
        self.navigator.stop()

    def reach(self, command: TemperatureTo, unit: str) -> None:
        """Bring the chamber's air to a temperature as fast as it can.

        Raises ConditionNotReached where it does not come there in the plan's time.
        """
        self.run.apply(command)
        temperature_degC = command.temperature_degC
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

    def go_to(self, moves: Sequence[AxisCommand[Any]], unit: str, doing: str) -> None:
        """Bring axes of the table to angles, each at rest before the next moves."""
        for move in moves:
            self.run.apply(move)
            axis = move.axis_number(self.run.bench)
            while self.table.is_moving(axis):
                self.follow(self.run.now_s + MOVING_LOOK_S, unit, doing)

    def rest(self, unit: str, doing: str) -> None:
        """Stand for the plan's time to settle, and until an output came with the attitude at rest.

        Raises InstrumentError where none comes any more.
        """
        from station.roles.base import ARRIVAL

        clock = self.run.clock
        rests_s = clock.now() + SETTLED_S
        self.follow(clock.now() + self.parameters.settle_s, unit, doing)
        self.take(unit)
        while self.newest is None or self.newest[ARRIVAL][0] < rests_s:
            self.follow(clock.now() + MOVING_LOOK_S, unit, doing)
            self.take(unit)
        # An output that is read right before the next movement is not taken for one at rest.
        self.follow(float(self.newest[ARRIVAL][0]) + ARRIVES_WITHIN_S, unit, doing)
        self.take(unit)

    def turn_around(
        self, turn: tuple[AxisAtRate, AxisBy], unit: str, doing: str
    ) -> tuple[float, float, float, float]:
        """Turn the vertical axis once at the plan's rate, at rest before and after.

        Returns the run times of the end of the first rest, of both ends of the second, and the
        angle that the encoder turned in deg.
        """
        clock, (at_rate, by_angle) = self.run.clock, turn
        outer = by_angle.axis_number(self.run.bench)
        self.rest(unit, doing)
        before_s = clock.now()
        before_deg = self.run.prepare(by_angle) or 0.0
        left_deg = before_deg + by_angle.angle_deg - self.table.angle_deg(outer)
        self.run.apply(at_rate)
        ends_s = clock.now() + abs(left_deg / at_rate.rate_deg_per_s) - SHORT_OF_TURN_S
        while clock.now() < ends_s:
            self.follow(min(clock.now() + TURNING_LOOK_S, ends_s), unit, doing)
            self.table.is_at_rate(outer)  # raises where it does not keep it
        self.go_to([by_angle], unit, doing)
        rests_s = clock.now()
        self.rest(unit, doing)
        return before_s, rests_s, clock.now(), self.table.angle_deg(outer) - before_deg
