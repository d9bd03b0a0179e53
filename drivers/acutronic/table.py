"""The axes of a table at an ACUTROL3000: read together, commanded one by one, and judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from contextlib import suppress

from drivers.acutronic.line import (
    AT_POSITION,
    AT_RATE,
    HARDWARE_ABORT,
    AclLine,
    AclSettings,
    Status,
    fault_of,
    number,
    queries,
)
from drivers.generic.axes_table import MARGIN_S, AxesTable
from drivers.generic.table_axis import TURN_DEG, AxisState, Doing
from drivers.transport.text_line import errors_until_none
from station.errors import InstrumentError
from station.roles import Place

STEP_DEG, STEP_AGAIN_DEG = 150.0, 100.0
"""A demand is at most the first away, less than half a turn; the next one is made when less than
the second is left, so that an axis that is looked at often does not slow down on its way."""


class Table(AxesTable):
    """All axes, with what was read of them last."""

    def __init__(
        self,
        place: Place,
        settings: AclSettings,
        line: AclLine,
        limit: Callable[[str], float],
    ) -> None:
        super().__init__(place, settings, limit)
        self._line = line
        asked = ("Position", "Rate")
        self._reads = tuple(f":Read:{what}? {n}" for n in self.axes for what in asked)
        self._rates = self._reads[1::2]
        self.state_queries = tuple(queries(n)[0] for n in self.axes)

    def look(self, *more: str) -> list[float]:
        """Read angle and rate of every axis from one servo frame; return what more was asked."""
        with self._looking:
            values = self._line.numbers(*self._reads, *more)
            now_s = self._place.clock.now()
            for place, state in enumerate(self.axes.values()):
                state.rate = values[2 * place + 1]
                state.count.take(values[2 * place], now_s)
        self._say_angle()
        self._say_rate()
        return values[len(self._reads) :]

    def look_at_rates(self) -> None:
        """Read the rate of every axis from one servo frame; other looks count the turns."""
        with self._looking:
            for state, rate in zip(
                self.axes.values(), self._line.numbers(*self._rates), strict=True
            ):
                state.rate = rate
        self._say_rate()

    def look_at(self, state: AxisState) -> Status:
        """Read all axes and the status of one; raises InstrumentError for a fault of that one."""
        _, *registers = queries(state.number)
        dynamic, fault, *states = map(int, self.look(*registers, *self.state_queries))
        self.say_interlock(states)
        status = Status(states[list(self.axes).index(state.number)], dynamic, fault)
        concerned = state.homed or state.doing is not Doing.NOTHING
        if concerned and (status.broken or not (status.servoed or state.doing is Doing.CLOSING)):
            state.forgets()
            raise fault_of(self._place.name, self._line, state.number, status)
        return status

    def status(self, state: AxisState) -> Status:
        """Read the status of one axis."""
        return Status(*map(int, self._line.numbers(*queries(state.number))))

    def set_rate(self, state: AxisState, rate: float, doing: Doing) -> None:
        """Demand a rate, in rate mode; the demand comes first, as a mode begins with its last."""
        n, measured = state.number, None
        if state.mode != "Rate":
            self.look()
            measured = state.rate
        began_s = self._place.clock.now()
        self._line.command(f":Demand:Rate {n},{number(rate)}")
        if state.mode != "Rate":
            self._line.command(f":Mode {n},Rate")
        state.mode, state.rate_demand, state.target_deg = "Rate", rate, None
        acceleration = self._limit("acceleration")
        change = abs(
            rate - state.count.planned_rate(began_s) if measured is None else rate - measured
        )
        state.count.turns_at(began_s, rate, acceleration, measured)
        state.begins(doing, began_s + 2 * change / acceleration + MARGIN_S)
        state.rate_demand = self._line.verify(n, "Rate", rate, "Rate")
        self.say_motion()

    def step(self, state: AxisState) -> None:
        """Demand the target, or an angle on the way to it that is less than half a turn away."""
        assert state.target_deg is not None
        n, here_deg, step_deg = state.number, state.count.angle_deg, state.target_deg
        if state.count.continuous and abs(step_deg - here_deg) > STEP_DEG:
            step_deg = here_deg + math.copysign(STEP_DEG, step_deg - here_deg)
        demand_deg = round(step_deg % TURN_DEG if state.count.continuous else step_deg, 6)
        began_s = self._place.clock.now()
        self._line.command(f":Demand:Position {n},{number(demand_deg)}")
        if state.mode != "Position":
            self._line.command(f":Mode {n},Position")
        state.mode, state.step_deg = "Position", step_deg
        rate, acceleration = self._limit("rate"), self._limit("acceleration")
        state.count.aims_at(began_s, step_deg, rate)
        takes_s = abs(step_deg - here_deg) / rate + 2 * rate / acceleration
        state.begins(Doing.POSITIONING, began_s + 2 * takes_s + MARGIN_S)
        self._line.verify(n, "Position", demand_deg, "Position")
        self.say_motion()

    def has_done(self, state: AxisState, status: Status) -> bool:
        """Whether an axis has done what was commanded; begins what comes next where it has not."""
        rests = not self.is_turning(state)
        if state.doing is Doing.CLOSING:
            if status.servoed and self.settings.zero == "search":
                try:
                    self._line.command(f":Mode:Home {state.number}")
                except InstrumentError:
                    state.forgets()
                    raise
                state.begins(Doing.SEARCHING, self._place.clock.now() + self.settings.home_within_s)
                return False
            return status.servoed and self._knows_zero(state)
        if state.doing is Doing.SEARCHING:
            homed = bool(status.dynamic & AT_POSITION) and rests and self._knows_zero(state)
            if homed:
                self._need_zero(state)
            return homed
        self.need_turns(state)
        if state.doing is Doing.STOPPING:
            stands = bool(status.dynamic & AT_RATE) and rests
            if stands and state.target_deg is not None:
                self.step(state)
                return False
            return stands
        assert state.target_deg is not None
        angle_deg = state.count.angle_deg
        if state.step_deg != state.target_deg:
            if abs(state.step_deg - angle_deg) < STEP_AGAIN_DEG:
                self.step(state)
            return False
        there = abs(angle_deg - state.target_deg) <= self.settings.in_position_deg
        return bool(status.dynamic & AT_POSITION) and rests and there

    def has_rate(self, state: AxisState, status: Status) -> bool:
        """Whether an axis has reached the commanded rate, now or before."""
        state.at_rate = state.at_rate or (bool(status.dynamic & AT_RATE) and self.agrees(state))
        return state.at_rate

    def brake(self, state: AxisState) -> None:
        """Have an axis that may turn come to rest."""
        n = state.number
        if self._line.mode(n) not in ("Off", "Abort"):
            self._line.tell(f":Demand:Rate {n},0")
            self._line.tell(f":Mode {n},Rate")

    def say_interlock(self, states: Iterable[int]) -> bool:
        """Publish, and return, whether the interlock broke; from the states of all axes."""
        broken = any(state & HARDWARE_ABORT for state in states)
        self._place.publish("chain", "open" if broken else "closed")
        return broken

    def last_attempt(self, message: str) -> None:
        """Send a command once more, whatever comes back, or where nothing can come back."""
        try:
            self._line.tell(message)
        except InstrumentError:
            with suppress(InstrumentError):
                self._line.blindly(message)

    def forget_errors(self) -> None:
        """Empty the error queue of what was refused and did not matter."""
        with suppress(InstrumentError):
            self._line.forget_errors()

    def take_errors(self) -> list[str]:
        """Return the errors that it keeps, the oldest first, and leave its queue empty."""
        return errors_until_none(self._place.name, self._line.next_error)

    def _need_zero(self, state: AxisState) -> None:
        """Raise InstrumentError where an axis does not stand at zero after the search for it."""
        if abs(state.count.angle_deg) <= self.settings.in_position_deg:
            return
        where_deg = state.count.angle_deg
        state.forgets()
        raise InstrumentError(
            self._place.name,
            f"searched the zero of axis {state.number}",
            f"its encoder reads {where_deg:.5f} deg after that, not zero",
            "find the zero at the controller and write settings.zero: absolute, where its firmware "
            "does not know :Mode:Home",
        )
