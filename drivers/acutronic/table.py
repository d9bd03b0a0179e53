"""The axes of a table at an ACUTROL3000: read together, commanded one by one, and judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from contextlib import suppress

from drivers.acutronic.axis import MOVES, TURN_DEG, AclSettings, AxisState, Doing, TurnCount
from drivers.acutronic.line import (
    AT_POSITION,
    AT_RATE,
    HARDWARE_ABORT,
    AclLine,
    Status,
    astray,
    fault_of,
    number,
    queries,
    wrong_rate,
)
from drivers.transport.text_line import errors_until_none
from station.errors import InputError, InstrumentError
from station.roles import Place

STEP_DEG, STEP_AGAIN_DEG = 150.0, 100.0
"""A demand is at most the first away, less than half a turn; the next one is made when less than
the second is left, so that an axis that is looked at often does not slow down on its way."""

MARGIN_S = 5.0
BRAKES_LATE_S = 2.0
RATE_AGREES, RATE_KEPT = 1e-3, 0.05


class Table:
    """All axes, with what was read of them last."""

    def __init__(
        self,
        place: Place,
        settings: AclSettings,
        line: AclLine,
        limit: Callable[[str], float],
    ) -> None:
        self._place, self._settings, self._line, self._limit = place, settings, line, limit
        numbers = range(1, settings.axes + 1)
        self.axes = {n: AxisState(n, TurnCount(n in settings.turns_for_ever)) for n in numbers}
        self._reads = tuple(f":Read:{what}? {n}" for n in numbers for what in ("Position", "Rate"))
        self._rates = self._reads[1::2]
        self.state_queries = tuple(queries(n)[0] for n in numbers)
        self._looking = place.clock.lock(f"{place.name} turns")

    def axis(self, n: int) -> AxisState:
        """Return an axis; InputError where the table has none of that number."""
        if n not in self.axes:
            raise InputError(f"{self._place.name}: the table has no axis {n!r}; see settings.axes")
        return self.axes[n]

    def look(self, *more: str) -> list[float]:
        """Read angle and rate of every axis from one servo frame; return what more was asked."""
        with self._looking:
            values = self._line.numbers(*self._reads, *more)
            now_s = self._place.clock.now()
            for place, state in enumerate(self.axes.values()):
                state.rate = values[2 * place + 1]
                state.count.take(values[2 * place], now_s)
        self._place.publish("angle", self._largest("angle"), "deg")
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
            if status.servoed and self._settings.zero == "search":
                try:
                    self._line.command(f":Mode:Home {state.number}")
                except InstrumentError:
                    state.forgets()
                    raise
                state.begins(
                    Doing.SEARCHING, self._place.clock.now() + self._settings.home_within_s
                )
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
        there = abs(angle_deg - state.target_deg) <= self._settings.in_position_deg
        return bool(status.dynamic & AT_POSITION) and rests and there

    def has_rate(self, state: AxisState, status: Status) -> bool:
        """Whether an axis has reached the commanded rate, now or before."""
        near = self._settings.at_rest_deg_per_s + RATE_AGREES * abs(state.rate_demand)
        agrees = abs(state.rate - state.rate_demand) <= near
        state.at_rate = state.at_rate or (bool(status.dynamic & AT_RATE) and agrees)
        return state.at_rate

    def brake(self, state: AxisState) -> None:
        """Have an axis that may turn come to rest."""
        n = state.number
        if self._line.mode(n) not in ("Off", "Abort"):
            self._line.tell(f":Demand:Rate {n},0")
            self._line.tell(f":Mode {n},Rate")

    def end_tasks(self) -> None:
        """Take it that all axes brake since the last look and have nothing else to do."""
        acceleration = self._place.limits.get("acceleration", 1.0)
        for state in self.axes.values():
            state.count.turns_at(self._place.clock.now(), 0.0, acceleration, state.rate)
            if state.doing in (Doing.CLOSING, Doing.SEARCHING):
                state.forgets()
            state.doing, state.target_deg, state.mode = Doing.NOTHING, None, ""

    def turns(self) -> bool:
        """Whether any axis turned at the last look."""
        return any(self.is_turning(state) for state in self.axes.values())

    def is_turning(self, state: AxisState) -> bool:
        """Whether an axis turned at the last look."""
        return abs(state.rate) > self._settings.at_rest_deg_per_s

    def quantity(self, name: str) -> float | str:
        """Return the largest rate or angle of the last look, or the motion."""
        if name != "motion":
            return self._largest(name)
        moves = any(state.doing in MOVES for state in self.axes.values())
        return "moving" if moves or self.turns() else "at-rest"

    def say_motion(self) -> None:
        """Publish whether anything moves."""
        self._place.publish("motion", self.quantity("motion"))

    def say_interlock(self, states: Iterable[int]) -> bool:
        """Publish, and return, whether the interlock broke; from the states of all axes."""
        broken = any(state & HARDWARE_ABORT for state in states)
        self._place.publish("chain", "open" if broken else "closed")
        return broken

    def need_homed(self, state: AxisState, attempted: str) -> None:
        """Raise InstrumentError for an axis whose servo was not closed by `home`."""
        if not state.homed:
            came_back = "its servo was not closed, or has tripped, since the table was opened"
            raise InstrumentError(self._place.name, attempted, came_back, "home it first")

    def need_turns(self, state: AxisState) -> None:
        """Raise InstrumentError for an axis whose turns are no longer known."""
        if state.count.lost:
            state.homed = False
            came_back, do_now = state.count.lost, "look whether it is blocked, then home it again"
            raise InstrumentError(self._place.name, f"count axis {state.number}", came_back, do_now)

    def need_rate_kept(self, state: AxisState) -> None:
        """Raise InstrumentError for an axis that had its rate and has it no longer."""
        apart = abs(state.rate - state.rate_demand)
        allowed = self._settings.at_rest_deg_per_s + RATE_KEPT * abs(state.rate_demand)
        if state.doing is Doing.TURNING and state.at_rate and apart > allowed:
            raise wrong_rate(self._place.name, state)

    def need_angle_kept(self, state: AxisState) -> None:
        """Raise InstrumentError for an axis that stands elsewhere than where it was sent."""
        target_deg = state.target_deg
        if state.doing is not Doing.NOTHING or target_deg is None:
            return
        if abs(state.count.angle_deg - target_deg) > self._settings.in_position_deg:
            raise astray(self._place.name, state, "read the angle at rest", target_deg)

    def need_in_time(self, state: AxisState) -> None:
        """Raise InstrumentError for a task that should long be done."""
        if self._place.clock.now() <= state.until_s:
            return
        if state.doing is Doing.TURNING:
            raise wrong_rate(self._place.name, state)
        if state.doing is Doing.POSITIONING and not self.is_turning(state):
            raise astray(
                self._place.name, state, "waited for the axis to reach its angle", state.step_deg
            )
        raise InstrumentError(
            self._place.name,
            f"waited for axis {state.number} to {state.doing.value}",
            f"it is not done long after it should be; it turns at {state.rate:.4f} deg/s",
            "look whether something blocks it, then home it again",
        )

    def brakes_within_s(self) -> float:
        """Return the time in which the fastest axis that the bench allows comes to rest."""
        limits = self._place.limits
        return limits.get("rate", 0.0) / limits.get("acceleration", math.inf) + BRAKES_LATE_S

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

    def _knows_zero(self, state: AxisState) -> bool:
        """Count the turns of an axis anew, from an encoder whose zero is known."""
        state.count.reset()
        self.look()
        state.homed = True
        return True

    def _need_zero(self, state: AxisState) -> None:
        """Raise InstrumentError where an axis does not stand at zero after the search for it."""
        if abs(state.count.angle_deg) <= self._settings.in_position_deg:
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

    def _say_rate(self) -> None:
        self._place.publish("rate", self._largest("rate"), "deg/s")
        self.say_motion()

    def _largest(self, name: str) -> float:
        states = self.axes.values()
        values = [state.rate if name == "rate" else state.count.angle_deg for state in states]
        return max(values, key=abs)
