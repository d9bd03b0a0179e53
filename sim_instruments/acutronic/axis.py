"""One axis of an ACUTROL3000: profile, servo, encoder, status, and what trips it.

The servo makes the encoder follow the profile, a constant time late, so that what the encoder
reads wrongly becomes an error of the true angle. What ends a movement by itself (a trip) is known
when the movement begins, and so to the world, too; a command that comes in between holds only
after it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim_instruments.acutronic.language import (
    INTERLOCK_OPEN,
    NOT_SERVOED,
    OUT_OF_RANGE,
    STATUS_FROZEN,
    AclError,
    Act,
    Answer,
    number,
)
from sim_instruments.acutronic.table import (
    TRIP_ABOVE,
    AclTableData,
    Demands,
    ModeLimits,
)
from sim_instruments.generic.table_axis import (
    EncodedAxis,
    Encoder,
    pieces,
    too_far_from_s,
    too_fast_from_s,
)
from sim_instruments.world.rotation import RotationHistory

MODES = ("OFF", "POSITION", "RATE", "ARATE", "SYNTHESIS", "TRACK", "ABORT")
PROFILED = ("POSITION", "RATE")
CLOSES_IN_S = 0.3
TRIP_BRAKE = 3.0
"""An axis that trips brakes so many times harder than it ever accelerates."""

FALLS_BEHIND_AFTER_S = 0.7
TURN_DEG = 360.0
JERK_PER_ACCELERATION = 10.0

SERVOED, UNSERVOED, SOFTWARE_ABORT, HARDWARE_ABORT = 1 << 4, 1 << 5, 1 << 6, 1 << 7
AT_POSITION, AT_RATE = 1 << 8, 1 << 9
ABORT, RATE_TRIP = 1 << 0, 1 << 1


@dataclass(frozen=True)
class Status:
    """The three status registers of an axis."""

    state: int = UNSERVOED
    dynamic: int = AT_POSITION | AT_RATE
    fault: int = 0


class Axis(EncodedAxis):
    """One axis with its servo and its status."""

    def __init__(
        self,
        table: AclTableData,
        encoder: Encoder,
        rotation: RotationHistory | None,
        rng: np.random.Generator,
        now: Callable[[], float],
    ) -> None:
        super().__init__(table, encoder, rotation, rng, now)
        self._table = table
        self._plan = RotationHistory(encoder.reads(self.true_deg(now())))
        self.mode = "OFF"
        self.demands = Demands(position=self._plan_deg())
        half = table.largest_acceleration / 2
        self.limits = {
            mode: ModeLimits(
                table.largest_rate / 2,
                half,
                half * JERK_PER_ACCELERATION,
                TRIP_ABOVE * table.largest_rate,
                encoder.low_deg,
                encoder.high_deg,
            )
            for mode in MODES
        }
        self.contacts_open = False
        self.falls_behind = False
        self.stuck = False
        self._servoed_s = math.inf
        self._profiled_s = -math.inf
        self._frozen: Status | None = None
        self._trip: tuple[float, int] | None = None
        self._zero_s: float | None = None

    def catch_up(self) -> None:
        """Let happen what has become due: a trip, the end of a search for the encoder's zero."""
        now_s = self._now()
        if self._trip is not None and now_s >= self._trip[0]:
            fault, self._trip = self._trip[1], None
            self._freeze(SOFTWARE_ABORT, fault)
        if self._zero_s is not None and now_s >= self._zero_s:
            self._zero_s, self.encoder.lost_deg = None, 0.0
            self._plan.put(now_s, self.encoder.reads(self.true_deg(now_s)))

    def status(self) -> Status:
        """Return the registers, as they were at the last break until they are reset."""
        if self._frozen is not None:
            return self._frozen
        state = MODES.index(self.mode) | (SERVOED if self.servoed() else UNSERVOED)
        dynamic = 0
        if self._zero_s is None and self._now() >= self._complete_s():
            dynamic |= AT_POSITION if self.mode != "RATE" else AT_RATE
        return Status(state, dynamic)

    def servoed(self) -> bool:
        """Return whether the servo is closed."""
        return self._now() >= self._servoed_s

    def position_deg(self) -> float:
        """Return a reading of the encoder, within a turn where the axis is continuous."""
        reading = self.reading_deg()
        return reading % 360.0 if self.encoder.continuous else reading

    def close(self) -> None:
        """Close the servo, which takes a moment; the axis then holds where it is, mode off."""
        self._unlocked()
        if math.isinf(self._servoed_s):
            self._servoed_s = self._now() + CLOSES_IN_S
            self.mode = "OFF"

    def open(self) -> None:
        """Brake hard and open the servo."""
        self._brake(self._now())
        self._servoed_s, self.mode = math.inf, "OFF"

    def reset(self) -> None:
        """Forget a break that is over; refused while a contact is open."""
        if self.contacts_open:
            raise AclError(INTERLOCK_OPEN)
        self._frozen = None

    def emergency(self, time_s: float) -> None:
        """Brake hard, open the servo and freeze the status: a contact of the interlock opened."""
        self._brake(time_s)
        self._freeze(HARDWARE_ABORT, 0)

    def fall_behind(self, time_s: float) -> None:
        """Fall behind the profile, from now on or in the movement that comes next."""
        self.falls_behind = True
        if self.servoed() and time_s < self._plan.at_rest_from_s:
            self._trips(time_s, self._table.tracking_error)
            self.catch_up()

    def stick(self, time_s: float, stuck: bool) -> None:
        """Be blocked where it stands, or be free again and stay there."""
        self.stuck = stuck
        if stuck:
            self.rotation.halt(time_s)
        else:
            self._plan.put(time_s, self.encoder.reads(self.true_deg(time_s)))

    def set_mode(self, mode: str) -> None:
        """Change the mode; what was demanded of it before holds at once."""
        if mode in PROFILED:
            self._ready()
        if mode == "ABORT":
            if self.servoed():
                self._brake(self._now())
                self._freeze(SOFTWARE_ABORT, ABORT)
            return
        if mode not in (*PROFILED, "OFF"):
            raise AclError(OUT_OF_RANGE)  # oscillating and following are not simulated
        self.mode = mode
        if self.servoed():
            self._apply()

    def demand(self, mode: str, value: float) -> None:
        """Take a demand; it holds at once where the axis is in its mode."""
        if mode == "POSITION":
            low_deg, high_deg = self._range_deg(mode)
            if not low_deg <= value <= high_deg:
                raise AclError(OUT_OF_RANGE)
            wraps = self.encoder.continuous and abs(value) > TURN_DEG
            self.demands.position = value % TURN_DEG if wraps else value
        elif abs(value) > self._table.largest_rate:
            raise AclError(OUT_OF_RANGE)
        else:
            self.demands.rate = value
        if self.mode == mode and self.servoed():
            self._apply()

    def demand_change(self, change_deg: float) -> None:
        """Demand a position so far from the present one, half a turn at most."""
        if abs(change_deg) > 180.0:
            raise AclError(OUT_OF_RANGE)
        wanted = self._plan_deg() + change_deg
        self.demand("POSITION", wanted % 360.0 if self.encoder.continuous else wanted)
        self.demands.change_deg = change_deg

    def demand_vector(self, position: float, rate: float) -> None:
        """Take demands of position and rate."""
        self.demand("POSITION", position)
        self.demand("RATE", rate)

    def search_zero(self) -> None:
        """Turn to the encoder's zero and let it read zero there; the mode is then position."""
        self._ready()
        zero_deg = -self.encoder.lost_deg
        self.mode, self.demands.position = "POSITION", 0.0
        self._go(self._now(), self._nearest(zero_deg) if self.encoder.continuous else zero_deg)
        if self._trip is None:
            self._zero_s = self._profiled_s + self._table.delay_s

    def acceleration(self) -> float:
        """Return the true acceleration, in deg/s^2."""
        return next(pieces(self.rotation, self._now()))[-1]

    def interlock(self) -> str:
        """Return how the interlock of the axis stands."""
        return "Fault" if self._frozen is not None else "Close" if self.servoed() else "Open"

    def _range_deg(self, mode: str) -> tuple[float, float]:
        """Return the positions that a mode allows; of an axis that turns for ever, all."""
        if self.encoder.continuous:
            return -math.inf, math.inf
        return self.limits[mode].low_deg, self.limits[mode].high_deg

    def _unlocked(self) -> None:
        if self.contacts_open:
            raise AclError(INTERLOCK_OPEN)
        if self._frozen is not None:
            raise AclError(STATUS_FROZEN)

    def _ready(self) -> None:
        self._unlocked()
        if not self.servoed():
            raise AclError(NOT_SERVOED)

    def _apply(self) -> None:
        now_s, delay_s, limits = self._now(), self._table.delay_s, self.limits[self.mode]
        self._trip = self._zero_s = None
        if self.mode == "POSITION":
            wanted = self.demands.position
            self._go(now_s, self._nearest(wanted) if self.encoder.continuous else wanted)
            return
        rate = self.demands.rate if self.mode == "RATE" else 0.0
        rate = math.copysign(min(abs(rate), limits.rate), rate) * (1 + self._table.rate_error)
        acceleration = limits.acceleration
        self._profiled_s = self._plan.turn_at(now_s, rate, acceleration)
        if not self.stuck:
            self.rotation.turn_at(now_s + delay_s, rate, acceleration)
        self._look_ahead(now_s, bool(rate))

    def _go(self, now_s: float, reading_deg: float) -> None:
        limits = self.limits["POSITION"]
        moves = abs(reading_deg - self._plan_deg()) > 1e-6
        acceleration = limits.acceleration
        self._profiled_s = self._plan.move_to(now_s, reading_deg, limits.rate, acceleration)
        if not self.stuck:
            true_deg = self.encoder.true_at(reading_deg)
            begin_s = now_s + self._table.delay_s
            self.rotation.move_to(begin_s, true_deg, limits.rate, acceleration)
        self._look_ahead(now_s, moves)

    def _look_ahead(self, now_s: float, moves: bool) -> None:
        """Find the first thing that will end this movement, and let it."""
        limits, (low_deg, high_deg) = self.limits[self.mode], self._range_deg(self.mode)
        trips = [
            (too_fast_from_s(self._plan, now_s, limits.velocity_trip), RATE_TRIP),
            (too_far_from_s(self._plan, now_s, low_deg, high_deg), ABORT),
        ]
        if self.falls_behind and moves:
            trips.append((now_s + FALLS_BEHIND_AFTER_S, self._table.tracking_error))
        first_s, fault = min(trips)
        if math.isfinite(first_s):
            self._trips(first_s, fault)

    def _trips(self, time_s: float, fault: int) -> None:
        self._brake(time_s)
        self._trip = time_s, fault

    def _brake(self, time_s: float) -> None:
        self._trip = self._zero_s = None
        brake = TRIP_BRAKE * self._table.largest_acceleration
        self._plan.stop(time_s, brake)
        self.rotation.stop(time_s, brake)

    def _freeze(self, state: int, fault: int) -> None:
        mode = MODES.index("ABORT")
        self._servoed_s, self.mode = math.inf, "ABORT"
        self._frozen = Status(mode | state, 0, fault)

    def _complete_s(self) -> float:
        """Return when the profile is complete: it stands, or has its rate, and has settled."""
        return self._profiled_s + self._table.delay_s + self._table.settling_s

    def _nearest(self, reading_deg: float) -> float:
        """Return the angle that reads so and is nearest to where the profile stands."""
        here_deg = self._plan_deg()
        return here_deg + math.remainder(reading_deg - here_deg, 360.0)

    def _plan_deg(self) -> float:
        return self._plan.now_at(self._now())[0]


class Axes(dict[int, Axis]):
    """Axes by number; in a command ALL means each of them."""

    def named_axis(self, given: list[str]) -> Axis:
        """Return the axis that the first argument names."""
        n = number(given, 0)
        if n not in self:
            raise AclError(OUT_OF_RANGE)
        return self[int(n)]

    def named(self, given: list[str]) -> list[Axis]:
        """Return the axes that the first argument names."""
        if given and given[0].upper() == "ALL":
            return list(self.values())
        return [self.named_axis(given)]

    def answer(self, answer: Callable[[Axis], Answer]) -> Act:
        """Return a query whose first argument is an axis."""
        return lambda given: answer(self.named_axis(given))

    def command(self, act: Callable[[Axis, list[str]], object]) -> Act:
        """Return a command whose first argument is an axis, or ALL."""

        def command(given: list[str]) -> None:
            for axis in self.named(given):
                act(axis, given[1:])

        return command

    def act(self, act: Callable[[Axis], None]) -> Act:
        """Return a command of an axis, or ALL, without more arguments."""
        return self.command(lambda axis, _: act(axis))
