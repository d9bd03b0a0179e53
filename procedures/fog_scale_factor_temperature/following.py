"""Chamber, table and navigator of one run: followed all the time, whatever else is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from procedures.common.place_readings import PlaceReadings
from station.errors import StationError
from station.method.duration import NO_TIME, Duration, exactly
from station.method.motion import AxisCommand
from station.method.set_points import Bounded
from station.method.verbs import Recording, axis_of, look_until
from station.roles import Navigator, ThermalChamber, Turntable

from .parameters import AXES, FogParameters

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.method.run import Rates, Run

TABLE, CHAMBER, NAVIGATOR = "turntable", "thermal_chamber", "navigator"
ROOM_DEGC = 20.0
"""Where the record of the navigator is asked how well it reads the temperature."""
CHAMBER_EVERY_S = 30.0
LOOK_S = 8.0
"""Run time between two looks; less where time runs by itself, so that a kill loses little. A run
that ends early takes first what has come since the last one."""
MOVING_LOOK_S = 1.0
SETTLED_S = 1.0
ARRIVES_WITHIN_S = 0.4
"""Outputs are late: of a rest count those after the first of these and before the second."""
SOAK, WARM_UP, RANDOM = "soak", "warm-up", "random-rotation"
RAMP, COOLING, PROOF = "ramp", "cooling", "proof"
BETWEEN_TURNS = (SOAK, WARM_UP, RANDOM, RAMP, COOLING, PROOF)
"""Names under which is recorded what belongs to no turn; a turn's begins with RAMP or PROOF."""
CHAMBER_COLUMNS = {
    "process_value_degC": "degC, the chamber's air",
    "set_point_degC": "degC, what it is controlled to",
}


class Following:
    """The instruments of this procedure; what they say goes to the record all the time."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.parameters: FogParameters = run.parameters
        self.chamber = run.role(CHAMBER, ThermalChamber)
        self.table = run.role(TABLE, Turntable)
        self.navigator = run.role(NAVIGATOR, Navigator)
        self._outputs: Recording | None = None
        """Of the navigator, None where it gives none."""
        self._unit = ""
        self._chamber_due_s = self._due_s = run.now_s
        self._places = PlaceReadings(run)

    @property
    def rates(self) -> Rates:
        """The rows that come in a second, by instrument."""
        outputs = {} if self._outputs is None else self._outputs.rates
        return {CHAMBER: 1.0 / CHAMBER_EVERY_S, **outputs}

    @property
    def newest(self) -> Any:
        """The navigator's last row, a structured array of shape (1,); None before the first."""
        return None if self._outputs is None else self._outputs.newest.get(NAVIGATOR)

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
        self._places.look(unit)

    def take(self, unit: str) -> None:
        """Record the navigator's outputs that have come.

        Raises InstrumentError when none has for long.
        """
        clock = self.run.clock
        self._due_s = clock.now() + clock.holding_s(LOOK_S)
        if self._outputs is not None:
            self._outputs.unit = unit
            self._outputs.take()

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

        def act() -> None:
            if unit != self._unit:
                self.take(self._unit)
                self._unit = unit
            look_until(self.run, until_s, lambda: self.look(unit), doing, LOOK_S)

        lasts_s = max(until_s - self.run.now_s, 0.0)
        self.run.read(act, takes=exactly(lasts_s), rates=self.rates)

    def follow_until(
        self,
        reached: Callable[[], bool],
        expected_s: float,
        at_most_s: float,
        unit: str,
        doing: Callable[[], str],
    ) -> bool:
        """Record until something is reached; False where it was not within `at_most_s`."""

        def act() -> bool:
            until_s = self.run.now_s + at_most_s
            while not reached():
                if self.run.now_s >= until_s:
                    return False
                self.follow(self.run.now_s + LOOK_S, unit, doing())
            return True

        takes = Duration(min(expected_s, at_most_s), 0.0, at_most_s + LOOK_S)
        return self.run.read(act, True, takes, self.rates)

    def gyro_degC(self) -> NDArray[np.float64]:
        """Return the last temperatures of the three gyros (3,), NaN before any were heard."""
        import numpy as np

        if self.newest is None:
            return np.full(3, np.nan)
        return np.array([float(self.newest[f"temperature_{axis}_degC"][0]) for axis in AXES])

    def how_warm(self) -> str:
        """Return how warm the gyros are, for the operator."""
        return self.run.read(lambda: f"gyros {self.gyro_degC().mean():.1f} degC", "")

    def start_navigator(self) -> None:
        """Let the navigator output for the rest of the run."""
        rate_Hz = self.parameters.navigator_rate_Hz
        self.run.declare(Bounded(NAVIGATOR, f"outputs at {rate_Hz:g} Hz"))
        self.navigator.start(rate_Hz)
        self._outputs = Recording(self.run, self._unit, {NAVIGATOR: rate_Hz})

    def stop_navigator(self) -> None:
        """End the outputs; what is still on its way is left there."""
        self._outputs = None
        self.navigator.stop()

    def go_to(
        self, moves: Sequence[AxisCommand[Any]], unit: str, doing: str, takes: Duration = NO_TIME
    ) -> None:
        """Bring axes of the table to angles, each at rest before the next moves.

        `takes` is the bench time of each.
        """
        for move in moves:
            self.run.apply(move)
            self._come_to_rest(axis_of(self.run, move), unit, doing, takes)

    def _come_to_rest(self, axis: int, unit: str, doing: str, takes: Duration) -> None:
        def act() -> None:
            while self.table.is_moving(axis):
                self.follow(self.run.now_s + MOVING_LOOK_S, unit, doing)

        self.run.read(act, takes=takes, rates=self.rates)

    def rest(self, unit: str, doing: str) -> None:
        """Stand for the plan's time to settle, and until an output came with the attitude at rest.

        Raises InstrumentError where none comes any more.
        """
        from station.roles.base import ARRIVAL

        def act() -> None:
            now_s = self.run.now_s
            self.follow(now_s + self.parameters.settle_s, unit, doing)
            self.take(unit)
            while self.newest is None or self.newest[ARRIVAL][0] < now_s + SETTLED_S:
                self.follow(self.run.now_s + MOVING_LOOK_S, unit, doing)
                self.take(unit)
            # An output that is read right before the next movement is not taken for one at rest.
            self.follow(float(self.newest[ARRIVAL][0]) + ARRIVES_WITHIN_S, unit, doing)
            self.take(unit)

        self.run.read(act, takes=exactly(self.parameters.settle_s), rates=self.rates)
