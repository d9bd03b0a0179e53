"""Acutronic ACUTROL3000 motion controller with a table of up to three axes, in ACL.

Sources: manuals TM-8004-C (command language), TM-9384C (TCP/IP, port 9878) and public clients for
commands, modes, limits, status registers and the frozen status after a break. Not confirmed in a
primary source: how the eight characters before each answer are coded (taken as four digits of error
code and four of length; `framing: line` does without them); what `:Status:MSG? QERROR` answers
(taken as code and text); that a continuous axis reads 0 deg to 360 deg; and that `:Mode:Home` looks
for an encoder's zero.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import ClassVar

from drivers.acutrol3000_axis import MOVES, AxisState, Doing, settings_of
from drivers.acutrol3000_limits import limit, programme
from drivers.acutrol3000_line import AclLine
from drivers.acutrol3000_status import AT_POSITION, AT_RATE, Status, fault_of, queries
from drivers.acutrol3000_turns import TURN_DEG, TurnCount
from drivers.roles import Identity, Place, SafetyReading
from drivers.transport.retry import Repeatable, repeated
from station.errors import InstrumentError

STEP_DEG, STEP_AGAIN_DEG = 150.0, 100.0
"""A demand is never further away than the first, less than half a turn, and comes before less than
the second is left, so that an axis that is looked at often does not slow down on its way."""

CLOSES_WITHIN_S = 10.0
MARGIN_S = 5.0
RATE_AGREES, RATE_KEPT = 1e-3, 0.05
STILL_S, LOOK_S = 0.1, 0.05
DEMAND_AGREES = 2e-6


class Acutrol3000:
    """A table whose axes go to angles and turn at rates, each against its own encoder.

    In position mode a continuous axis takes the shortest way, so `move_to` goes in steps of less
    than half a turn, each begun by `is_moving`; turns are counted from the encoder and the plan.

    Limits: `rate` deg/s and `acceleration` deg/s^2 of every axis; `angle_low` and `angle_high` deg.
    Settings: `framing` (`framed` unless said, or `line`), `axes` (3), `continuous` (a list of the
    axes that turn for ever, all unless said), `zero` (`absolute` unless said; `search` where each
    encoder has to find its zero), `in_position` (0.001 deg), `at_rest` (0.01 deg/s), `home_within`
    (120 s). Published is the largest rate and angle of all axes, with their signs.
    """

    identifies_on: ClassVar[str] = "socket"
    recognises: ClassVar[str] = r"(?i)^(\d{8})?Acutronic[^,]*,\s*ACU?T(ROL)?3000,\s*(?P<serial>[^,]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?",
        r"(READ:(POSITION|RATE)|MODE|DEMAND:(POSITION|RATE)|LIMIT:\w+)\? [\w,]+",
        r"STATUS:CSR\? A\d(STATE|DYN|SWFLT)",
        r"DEMAND:RATE \d,0|MODE \d,RATE|MODE ALL,OFF",
    )
    """Neither what forgets what it tells (*STB?, MSG?) nor what closes a servo."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self._settings = settings = settings_of(place)
        numbers = range(1, settings.axes + 1)
        self._axes = {n: AxisState(n, TurnCount(n in settings.continuous)) for n in numbers}
        self._limits_written = False
        self._reads = tuple(f":Read:{what}? {n}" for n in numbers for what in ("Position", "Rate"))
        self._looking = place.clock.lock(f"{place.name} turns")
        self._line = AclLine(place, settings.framing)

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number and firmware."""
        answer = self._line.query("*IDN?")
        parts = [part.strip() for part in answer.split(",")]
        if len(parts) < 3 or "acutronic" not in parts[0].lower():
            raise self._line.odd("*IDN?", answer)
        return Identity(parts[0], parts[1], parts[2], ",".join(parts[3:]))

    def programme_limits(self) -> None:
        """Write rate, acceleration, trip and angle limits into the controller and read them back.

        Raises InstrumentError where the bench allows more than an axis is rated for.
        """
        self._line.forget_errors()
        for n in self._axes:
            programme(self.place, self._line, n, self._settings.continuous)
        self._limits_written = True

    def is_homed(self, axis: int) -> bool:
        """Whether the encoder's zero is known, the servo closed, and no turn was lost since."""
        state = self._axis(axis)
        if state.doing in (Doing.CLOSING, Doing.SEARCHING):
            self.is_moving(axis)
        return state.homed

    def home(self, axis: int) -> None:
        """Reset a break that is over, close the servo, and find the encoder's zero where it must.

        Where another axis turns while a break of this one is reset, it goes on.
        """
        state = self._axis(axis)
        self._prepare()
        state.forgets()
        if self._status(state).broken:
            self._line.command(":Interlock:Reset")
        self._line.command(f":Mode {axis},Off")
        self._line.command(f":Interlock:Close {axis}")
        state.begins(Doing.CLOSING, self.place.clock.now() + CLOSES_WITHIN_S)

    def move_to(self, axis: int, angle_deg: float) -> None:
        """Begin to go to an angle, by way of every angle between; returns at once.

        An axis that turns is stopped first. `is_moving` begins one step after the other. Raises
        InstrumentError for an angle beyond the bench's limits, and for an axis that is not homed.
        """
        state, attempted = self._axis(axis), f"go to {angle_deg:g} deg on axis {axis}"
        low = self.place.limits.get("angle_low", -math.inf)
        high = self.place.limits.get("angle_high", math.inf)
        if not (math.isfinite(angle_deg) and low <= angle_deg <= high):
            allowed = f"the bench allows {low:g} deg to {high:g} deg"
            do_now = "correct the plan's angles, or limits.angle_low and limits.angle_high"
            raise InstrumentError(self.place.name, attempted, allowed, do_now)
        self._need_homed(state, attempted)
        self._look()
        if abs(state.rate) > self._settings.at_rest and state.in_rate_mode:
            self._set_rate(state, 0.0)
            state.begins(Doing.STOPPING, self._ends_s(state.rate))
            state.target_deg = angle_deg
            return
        state.target_deg = angle_deg
        self._step(state)

    def turn(self, axis: int, rate_deg_per_s: float) -> None:
        """Begin to turn at a rate until told otherwise; returns at once.

        Raises InstrumentError for a rate beyond the bench's limit, and for an axis not homed.
        """
        state, attempted = self._axis(axis), f"turn axis {axis} at {rate_deg_per_s:g} deg/s"
        allowed = limit(self.place, "rate")
        if not abs(rate_deg_per_s) <= allowed:
            said = f"the bench allows {allowed:g} deg/s"
            raise InstrumentError(
                self.place.name, attempted, said, "correct the plan's rates, or limits.rate"
            )
        self._need_homed(state, attempted)
        self._set_rate(state, rate_deg_per_s)
        state.begins(Doing.TURNING, self._ends_s(rate_deg_per_s - state.rate))

    def stop(self, axis: int) -> None:
        """Begin to come to rest within the acceleration limit; returns at once."""
        state = self._axis(axis)
        if state.homed:
            self._set_rate(state, 0.0)
            state.begins(Doing.STOPPING, self._ends_s(limit(self.place, "rate")))

    def is_moving(self, axis: int) -> bool:
        """Whether the axis has not settled at its angle or rest; raises for a fault of the axis."""
        state = self._axis(axis)
        status = self._look_at(state)
        if state.doing is Doing.NOTHING:
            return abs(state.rate) > self._settings.at_rest
        if state.doing is Doing.TURNING:
            return True
        if self._is_done(state, status):
            state.doing = Doing.NOTHING
            self._say_motion()
            return False
        if self.place.clock.now() > state.until_s:
            self._late(state)
        return True

    def is_at_rate(self, axis: int) -> bool:
        """Whether the axis has settled at the rate it was told; raises for a fault of the axis."""
        state = self._axis(axis)
        status = self._look_at(state)
        if state.doing is not Doing.TURNING:
            return False
        self._need_rate_kept(state)
        near = self._settings.at_rest + RATE_AGREES * abs(state.rate_demand)
        agrees = abs(state.rate - state.rate_demand) <= near
        state.at_rate = state.at_rate or bool(status.dynamic & AT_RATE and agrees)
        if not state.at_rate and self.place.clock.now() > state.until_s:
            self._late(state)
        return state.at_rate

    def angle_deg(self, axis: int) -> float:
        """Return the encoder's angle, counted through every turn.

        Raises InstrumentError where the turns can no longer be told, where an axis does not keep
        its rate, and where one that stands is further than `in_position` from its angle.
        """
        state = self._axis(axis)
        self._look()
        self._need_turns(state)
        self._need_rate_kept(state)
        angle_deg, target_deg = state.count.angle_deg, state.target_deg
        if state.doing is Doing.NOTHING and target_deg is not None:
            if abs(angle_deg - target_deg) > self._settings.in_position_deg:
                raise self._astray(state, "read the angle at rest", target_deg)
        return angle_deg

    def rate_deg_per_s(self, axis: int) -> float:
        """Return the measured rate."""
        self._look()
        return self._axis(axis).rate

    def make_safe(self, deadline_s: float) -> None:
        """Brake every axis with its programmed acceleration, wait for rest, and set all modes off.

        Off is what the controller calls a controlled stop at zero rate: the servo stays closed, on
        purpose. A gimbal with a device that is not balanced would turn by itself with nothing that
        holds it. First comes rate zero, because with what acceleration Off brakes is not said.
        """
        try:
            for n, state in self._axes.items():
                mode = self._surely(f":Mode? {n}", lambda n=n: self._line.mode(n))
                if mode not in ("Off", "Abort"):
                    self._surely(f":Demand:Rate {n},0")
                    self._surely(f":Mode {n},Rate")
                if state.doing in (Doing.CLOSING, Doing.SEARCHING):
                    state.forgets()
                state.doing, state.target_deg, state.in_rate_mode = Doing.NOTHING, None, False
            while self._turns() and self.place.clock.now() < deadline_s - STILL_S:
                self.place.clock.sleep(LOOK_S)
            self._surely(":Mode ALL,Off")
        except InstrumentError:
            with suppress(InstrumentError):
                self._line.tell(":Mode ALL,Off")
            raise
        with suppress(InstrumentError):
            self._line.forget_errors()

    def read_safety(self) -> SafetyReading:
        """Read back that no axis turns, by rate and by two angles of each, and that modes are off."""
        self._surely(self._reads[0], self._look)
        first = {n: state.count.angle_deg for n, state in self._axes.items()}
        self.place.clock.sleep(STILL_S)
        turns = self._turns()
        said, safe = [], not turns
        for n, state in self._axes.items():
            mode = self._surely(f":Mode? {n}", lambda n=n: self._line.mode(n))
            moved_deg = abs(state.count.angle_deg - first[n])
            safe = safe and mode in ("Off", "Abort")
            safe = safe and moved_deg <= self._settings.at_rest * STILL_S + DEMAND_AGREES + 0.001
            said.append(
                f"axis {n} {mode.lower()} at {state.count.angle_deg:.3f} deg, {state.rate:.3f} deg/s"
            )
        return SafetyReading(safe, f"{'turning' if turns else 'at rest'}: {'; '.join(said)}")

    def read_quantity(self, quantity: str) -> float | str | None:
        """Return the largest angle in deg or rate in deg/s of all axes, or the motion, now."""
        if quantity not in ("motion", "angle", "rate"):
            return None
        self._look()
        if quantity == "motion":
            return self._motion()
        states = self._axes.values()
        values = [one.rate if quantity == "rate" else one.count.angle_deg for one in states]
        return max(values, key=abs)

    def close(self) -> None:
        """Close the line."""
        self._line.close()
