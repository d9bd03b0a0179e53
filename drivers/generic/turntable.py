"""A turntable of up to three axes as the role has it, whatever its maker."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

from drivers.generic.axes_table import AxesTable
from drivers.generic.table_axis import Doing
from station.roles import Driver

STILL_S, LOOK_S = 0.1, 0.05


class AxesTurntable(Driver):
    """A table whose axes go to angles and turn at rates, each against its own encoder.

    Limits: `rate` deg/s and `acceleration` deg/s^2 of every axis; `angle_low` and `angle_high` deg.

    Watched are the largest rate and the largest angle of all axes, with their signs. A maker's own
    has `identify`, `programme_limits`, `home`, `make_safe` and `read_safety`.
    """

    without_limits = "the table does not turn"
    _table: AxesTable

    def is_homed(self, axis: int) -> bool:
        """Whether the encoder's zero is known, and the servo has been closed ever since."""
        state = self._table.axis(axis)
        if state.doing in (Doing.CLOSING, Doing.SEARCHING):
            self.is_moving(axis)
        return state.homed

    def move_to(self, axis: int, angle_deg: float) -> None:
        """Begin to go to an angle, by way of every angle between; returns at once.

        An axis that turns is stopped first. `is_moving` begins one step after the other. Raises
        InstrumentError for an angle beyond the bench's limits, and for an axis that is not homed.
        """
        state, attempted = self._table.axis(axis), f"go to {angle_deg:g} deg on axis {axis}"
        low = self.place.limits.get("angle_low", -math.inf)
        high = self.place.limits.get("angle_high", math.inf)
        if not (math.isfinite(angle_deg) and low <= angle_deg <= high):
            allowed = f"the bench allows {low:g} deg to {high:g} deg"
            do_now = "correct the plan's angles, or limits.angle_low and limits.angle_high"
            raise self.error(attempted, allowed, do_now)
        self._table.need_homed(state, attempted)
        self._table.look()
        self._table.need_turns(state)
        if self._table.stops_first(state):
            self._table.set_rate(state, 0.0, Doing.STOPPING)
            state.target_deg = angle_deg
        else:
            state.target_deg = angle_deg
            self._table.step(state)

    def turn(self, axis: int, rate_deg_per_s: float) -> None:
        """Begin to turn at a rate until commanded otherwise; returns at once.

        Raises InstrumentError for a rate beyond the bench's limit, and for an axis not homed.
        """
        state, attempted = self._table.axis(axis), f"turn axis {axis} at {rate_deg_per_s:g} deg/s"
        allowed = self.limit("rate")
        if not abs(rate_deg_per_s) <= allowed:
            came_back = f"the bench allows {allowed:g} deg/s"
            do_now = "correct the plan's rates, or limits.rate"
            raise self.error(attempted, came_back, do_now)
        self._table.need_homed(state, attempted)
        self._table.set_rate(state, rate_deg_per_s, Doing.TURNING)

    def stop(self, axis: int) -> None:
        """Begin to come to rest within the acceleration limit; returns at once."""
        state = self._table.axis(axis)
        if state.homed:
            self._table.set_rate(state, 0.0, Doing.STOPPING)

    def is_moving(self, axis: int) -> bool:
        """Whether the axis has not settled at its angle or rest; raises for a fault of the axis."""
        state = self._table.axis(axis)
        status = self._table.look_at(state)
        if state.doing is Doing.NOTHING:
            return self._table.is_turning(state)
        if state.doing is Doing.TURNING:
            return True
        if self._table.has_done(state, status):
            state.doing = Doing.NOTHING
            self._table.say_motion()
            return False
        self._table.need_in_time(state)
        return True

    def is_at_rate(self, axis: int) -> bool:
        """Whether the axis has settled at the commanded rate; raises for a fault of the axis."""
        state = self._table.axis(axis)
        status = self._table.look_at(state)
        if state.doing is not Doing.TURNING:
            return False
        self._table.need_rate_kept(state)
        if not self._table.has_rate(state, status):
            self._table.need_in_time(state)
        return state.at_rate

    def angle_deg(self, axis: int) -> float:
        """Return the encoder's angle, counted through every turn.

        Raises InstrumentError where the turns are no longer known, where an axis does not keep
        its rate, and where any that stands turns, or is further than `in_position` from its angle.
        """
        state = self._table.axis(axis)
        self._table.look()
        self._table.need_turns(state)
        self._table.need_rate_kept(state)
        self._table.need_others_kept(state)
        return state.count.angle_deg

    def rate_deg_per_s(self, axis: int) -> float:
        """Return the measured rate."""
        state = self._table.axis(axis)
        self._table.look()
        return state.rate

    def await_rest(self, deadline_s: float) -> None:
        """Wait until the axes have braked, if it heard: until then nothing else goes on."""
        stands_s = self.place.clock.now() + self._table.brakes_within_s()
        self.place.clock.sleep_until(min(stands_s, deadline_s))

    def _come_to_rest(self, deadline_s: float) -> None:
        """Brake every axis and wait until all rest, or for nearly as long as there is."""
        table = self._table
        for state in table.axes.values():
            table.brake(state)
        table.look()
        table.end_tasks()
        while table.turns() and self.place.clock.now() < deadline_s - STILL_S:
            self.place.clock.sleep(LOOK_S)
            table.look()

    def _stands(self, proof: Callable[..., list[Any]]) -> bool:
        """Whether no axis turns: by rate, and by two angles of each; `proof` asks for them."""
        table, angles = self._table, []
        for _ in range(2):
            proof(table.look)
            angles.append([state.count.angle_deg for state in table.axes.values()])
            self.place.clock.sleep(STILL_S)
        settings = table.settings
        most_deg = settings.at_rest_deg_per_s * STILL_S + settings.in_position_deg
        moved_deg = [abs(after - before) for before, after in zip(*angles, strict=True)]
        return not table.turns() and max(moved_deg) <= most_deg

    def _rates(self, quantity: str) -> float | str | None:
        self._table.look_at_rates()
        return self._table.quantity(quantity)

    def _angle_deg(self) -> float | str | None:
        self._table.look()
        return self._table.quantity("angle")

    quantities: ClassVar = {
        "rate": lambda self: self._rates("rate"),
        "angle": _angle_deg,
        "motion": lambda self: self._rates("motion"),
    }
