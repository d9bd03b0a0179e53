"""The axes of a turntable, read together, commanded one by one, and judged; whatever its maker."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from drivers.generic.table_axis import MOVES, AxesSettings, AxisState, Doing, TurnCount
from station.errors import InputError, InstrumentError
from station.roles import Place

MARGIN_S = 5.0
BRAKES_LATE_S = 2.0
RATE_AGREES, RATE_KEPT = 1e-3, 0.05


class AxesTable(ABC):
    """All axes, with what was read of them last; a maker's own knows how each is asked and told."""

    when_commanded_by_another = (
        "see that nobody works at the table's panel and that no other program talks to it"
    )

    def __init__(self, place: Place, settings: AxesSettings, limit: Callable[[str], float]) -> None:
        self.settings = settings
        self._place, self._limit = place, limit
        numbers = range(1, settings.axes + 1)
        self.axes = {n: AxisState(n, TurnCount(n in settings.turns_for_ever)) for n in numbers}
        self._looking = place.clock.lock(f"{place.name} turns")

    @abstractmethod
    def look(self) -> Any:
        """Read angle and rate of every axis, count its turns, and publish both."""

    @abstractmethod
    def look_at_rates(self) -> None:
        """Read the rate of every axis; other looks count the turns."""

    @abstractmethod
    def look_at(self, state: AxisState) -> Any:
        """Read all axes and the status of one; raises InstrumentError for a fault of that one."""

    @abstractmethod
    def set_rate(self, state: AxisState, rate: float, doing: Doing) -> None:
        """Begin to turn at a rate."""

    @abstractmethod
    def step(self, state: AxisState) -> None:
        """Begin to go to the target, or to an angle on the way to it."""

    @abstractmethod
    def has_done(self, state: AxisState, status: Any) -> bool:
        """Whether an axis has done what was commanded; begins what comes next where it has not."""

    @abstractmethod
    def has_rate(self, state: AxisState, status: Any) -> bool:
        """Whether an axis has reached the commanded rate, now or before."""

    @abstractmethod
    def brake(self, state: AxisState) -> None:
        """Have an axis that may turn come to rest."""

    def axis(self, n: int) -> AxisState:
        """Return an axis; InputError where the table has none of that number."""
        if n not in self.axes:
            raise InputError(f"{self._place.name}: the table has no axis {n!r}; see settings.axes")
        return self.axes[n]

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
        return abs(state.rate) > self.settings.at_rest_deg_per_s

    def stops_first(self, state: AxisState) -> bool:
        """Whether an axis has to stand before it can be sent to an angle."""
        return state.mode == "Rate" and self.is_turning(state)

    def quantity(self, name: str) -> float | str:
        """Return the largest rate or angle of the last look, or the motion."""
        if name != "motion":
            return self._largest(name)
        moves = any(state.doing in MOVES for state in self.axes.values())
        return "moving" if moves or self.turns() else "at-rest"

    def say_motion(self) -> None:
        """Publish whether anything moves."""
        self._place.publish("motion", self.quantity("motion"))

    def agrees(self, state: AxisState) -> bool:
        """Whether an axis turned at its commanded rate at the last look."""
        near = self.settings.at_rest_deg_per_s + RATE_AGREES * abs(state.rate_demand)
        return abs(state.rate - state.rate_demand) <= near

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
        allowed = self.settings.at_rest_deg_per_s + RATE_KEPT * abs(state.rate_demand)
        if state.doing is Doing.TURNING and state.at_rate and apart > allowed:
            raise self.wrong_rate(state)

    def need_angle_kept(self, state: AxisState) -> None:
        """Raise InstrumentError for an axis that stands elsewhere than where it was sent."""
        target_deg = state.target_deg
        if state.doing is not Doing.NOTHING or target_deg is None:
            return
        if abs(state.count.angle_deg - target_deg) > self.settings.in_position_deg:
            raise self.astray(state, "read the angle at rest", target_deg)

    def need_others_kept(self, moved: AxisState) -> None:
        """Raise InstrumentError where any axis that should stand is elsewhere, or turns.

        A device on a plate that another axis tilts does not turn as it was meant to.
        """
        for state in self.axes.values():
            self.need_angle_kept(state)
        if strangers := self.strangers():
            raise self.commanded_by_another(moved, strangers[0], "no angle counts")

    def strangers(self) -> list[AxisState]:
        """Return the axes that turned at the last look though nothing commanded them to."""
        now_s = self._place.clock.now()
        return [
            state
            for state in self.axes.values()
            if state.doing is Doing.NOTHING
            and self.is_turning(state)
            and not state.count.planned_rate(now_s)
        ]

    def commanded_by_another(
        self, looked_at: AxisState, stranger: AxisState, so: str
    ) -> InstrumentError:
        """Return that an axis turns that nobody here commanded, and what follows."""
        return InstrumentError(
            self._place.name,
            f"looked at axis {looked_at.number}",
            f"axis {stranger.number} turns at {stranger.rate:.4f} deg/s, which nobody here "
            f"commanded; {so}",
            self.when_commanded_by_another,
        )

    def need_in_time(self, state: AxisState) -> None:
        """Raise InstrumentError for a task that should long be done."""
        if self._place.clock.now() <= state.until_s:
            return
        if state.doing is Doing.TURNING:
            raise self.wrong_rate(state)
        if state.doing is Doing.POSITIONING and not self.is_turning(state):
            raise self.astray(state, "waited for the axis to reach its angle", state.step_deg)
        raise InstrumentError(
            self._place.name,
            f"waited for axis {state.number} to {state.doing.value}",
            f"it is not done long after it should be; it turns at {state.rate:.4f} deg/s",
            "look whether something blocks it, and whether settings.at_rest is above the noise of "
            "its rate at rest, then home it again",
        )

    def astray(self, state: AxisState, attempted: str, where_deg: float) -> InstrumentError:
        """Return that an axis stands elsewhere than it was sent; it must be homed again."""
        state.homed = False
        return InstrumentError(
            self._place.name,
            attempted,
            f"the encoder of axis {state.number} reads {state.count.angle_deg:.5f} deg where "
            f"{where_deg:.5f} deg was commanded, more than settings.in_position apart",
            "look for a blocked axis or a loose encoder cable, then home it again",
        )

    def wrong_rate(self, state: AxisState) -> InstrumentError:
        """Return that an axis turns at another rate than commanded; it must be homed again."""
        state.homed = False
        return InstrumentError(
            self._place.name,
            f"turn axis {state.number} at {state.rate_demand:g} deg/s",
            f"it turns at {state.rate:.4f} deg/s",
            "look whether something blocks it, then home it again",
        )

    def brakes_within_s(self) -> float:
        """Return the time in which the fastest axis that the bench allows comes to rest."""
        limits = self._place.limits
        return limits.get("rate", 0.0) / limits.get("acceleration", math.inf) + BRAKES_LATE_S

    def _knows_zero(self, state: AxisState) -> bool:
        """Count the turns of an axis anew, from an encoder whose zero is known."""
        state.count.reset()
        self.look()
        state.homed = True
        return True

    def _say_angle(self) -> None:
        self._place.publish("angle", self._largest("angle"), "deg")

    def _say_rate(self) -> None:
        self._place.publish("rate", self._largest("rate"), "deg/s")
        self.say_motion()

    def _largest(self, name: str) -> float:
        states = self.axes.values()
        values = [state.rate if name == "rate" else state.count.angle_deg for state in states]
        return max(values, key=abs)
