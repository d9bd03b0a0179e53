"""One axis of an Ideal Aerosmith table: motor, profile, encoder, and what stops it.

The servo makes the encoder follow the profile, a constant time late, so that what the encoder
reads wrongly becomes an error of the true angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sim_instruments.generic.table_axis import EncodedAxis, Encoder, TableData, too_far_from_s
from sim_instruments.truth import Truth
from sim_instruments.world.rotation import RotationHistory

HOMES = ("done", "never", "refused")
MOTOR_ON_IN_S = 0.3
HOME_RATE = 20.0
STOP_BRAKE = 3.0
"""A motor that trips brakes so many times harder than the axis ever accelerates."""

FALLS_BEHIND_AFTER_S = 0.7


class Refused(Exception):
    """A command that the controller does not take."""


class AtlTableData(TableData):
    """That and `home`, what HOM does: `done`, `never` ends, or is `refused`."""

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.home = truth.word("home", HOMES, HOMES[0])


class Axis(EncodedAxis):
    """One axis with its motor."""

    def __init__(
        self,
        table: AtlTableData,
        encoder: Encoder,
        rotation: RotationHistory | None,
        rng: np.random.Generator,
        now: Callable[[], float],
        *,
        motor_on: bool,
    ) -> None:
        super().__init__(table, encoder, rotation, rng, now)
        self._table = table
        self._plan = RotationHistory(encoder.reads(self.true_deg(self._now())))
        self.velocity = table.largest_rate / 2
        self.acceleration = table.largest_acceleration / 2
        self.pressed = self.falls_behind = self.stuck = False
        self._motor_s = now() if motor_on else math.inf
        self._planned_s = -math.inf
        self._trips_s = math.inf
        self._zero_s: float | None = None

    def catch_up(self) -> None:
        """Let happen what has become due: a trip, the end of a search for the encoder's zero."""
        now_s = self._now()
        if now_s >= self._trips_s:
            self._trip(self._trips_s)
        if self._zero_s is not None and now_s >= self._zero_s:
            zero_s, self._zero_s, self.encoder.lost_deg = self._zero_s, None, 0.0
            true_deg, _ = self.rotation.now_at(zero_s)
            self._plan.put(zero_s, self.encoder.reads(true_deg))
            self._planned_s = -math.inf

    @property
    def motor_on(self) -> bool:
        """Whether the motor holds the axis."""
        return self._now() >= self._motor_s

    @property
    def complete(self) -> bool:
        """Whether the profile is over and the axis stands."""
        over_s = max(self._planned_s, self._plan.at_rest_from_s)
        return self._zero_s is None and self._now() >= over_s + self._table.delay_s

    def switch_on(self) -> None:
        """Switch the motor on, which takes a moment; the axis then holds where it is."""
        if self.pressed:
            raise Refused
        if math.isinf(self._motor_s):
            self._motor_s = self._now() + MOTOR_ON_IN_S

    def switch_off(self) -> None:
        """Brake hard and switch the motor off."""
        self._trip(self._now())

    def emergency(self, time_s: float, pressed: bool) -> None:
        """Have the emergency stop pressed, or let go; the motor stays off."""
        self.pressed = pressed
        if pressed:
            self._trip(time_s)

    def fall_behind(self, time_s: float) -> None:
        """Fall behind the profile, from a time on or in the movement that comes next."""
        self.falls_behind = True
        if self._motor_s <= time_s < self._plan.at_rest_from_s:
            self._trip(time_s)

    def stick(self, time_s: float, stuck: bool) -> None:
        """Be blocked where it stands, or be free again and stay there."""
        self.stuck = stuck
        if stuck:
            self._zero_s = None
            self.rotation.halt(time_s)
        else:
            self._plan.put(time_s, self.encoder.reads(self.rotation.now_at(time_s)[0]))

    def turn_at(self, rate: float) -> None:
        """Turn at a rate until told otherwise."""
        self._ready()
        if abs(rate) > self._table.largest_rate:
            raise Refused
        self._turn(rate)

    def stop(self) -> None:
        """Come to rest with the acceleration that is set; a motor that is off has nothing to do."""
        self._zero_s = None
        if self.motor_on:
            self._turn(0.0)

    def move_by(self, by_deg: float) -> None:
        """Go by an angle from where the profile stands."""
        self._ready()
        self._go(self._plan_deg() + by_deg, self.velocity)

    def move_to(self, reading_deg: float, nearest: bool) -> None:
        """Go to where the encoder reads an angle, or reads it within a turn."""
        self._ready()
        here_deg = self._plan_deg()
        if nearest and self.encoder.continuous:
            reading_deg = here_deg + math.remainder(reading_deg - here_deg, 360.0)
        self._go(reading_deg, self.velocity)

    def count_from(self, reading_deg: float) -> None:
        """Have the encoder read an angle where it stands."""
        self.encoder.lost_deg += self.encoder.reads(self.true_deg(self._now())) - reading_deg
        self._plan.put(self._now(), reading_deg)

    def search_zero(self) -> None:
        """Turn to the encoder's zero, and have it read zero there."""
        self._ready()
        if self._table.home == "refused":
            raise Refused
        if self._table.home == "never":
            self._turn(min(HOME_RATE, self._table.largest_rate))
            return
        zero_deg = -self.encoder.lost_deg
        if self.encoder.continuous:
            here_deg = self._plan_deg()
            zero_deg = here_deg + math.remainder(zero_deg - here_deg, 360.0)
        self._go(zero_deg, min(HOME_RATE, self.velocity))
        if not self.stuck:
            self._zero_s = self._planned_s + self._table.delay_s

    def _ready(self) -> None:
        if not self.motor_on:
            raise Refused
        self._zero_s = None

    def _turn(self, rate: float) -> None:
        now_s, true = self._now(), rate * (1 + self._table.rate_error)
        self._planned_s = self._plan.turn_at(now_s, true, self.acceleration)
        if not self.stuck:
            self.rotation.turn_at(now_s + self._table.delay_s, true, self.acceleration)
        self._look_ahead(bool(rate))

    def _go(self, reading_deg: float, rate: float) -> None:
        if not self.encoder.low_deg <= reading_deg <= self.encoder.high_deg:
            raise Refused
        now_s, moves = self._now(), abs(reading_deg - self._plan_deg()) > 1e-6
        self._planned_s = self._plan.move_to(now_s, reading_deg, rate, self.acceleration)
        if not self.stuck:
            true_deg = self.encoder.true_at(reading_deg)
            begin_s = now_s + self._table.delay_s
            self.rotation.move_to(begin_s, true_deg, rate, self.acceleration)
        self._look_ahead(moves)

    def _look_ahead(self, moves: bool) -> None:
        """Find what ends this movement if nothing does before: an end stop's switch, a fault."""
        now_s = self._now()
        ends_s = too_far_from_s(self._plan, now_s, self.encoder.low_deg, self.encoder.high_deg)
        falls_s = now_s + FALLS_BEHIND_AFTER_S if self.falls_behind and moves else math.inf
        self._trips_s = min(ends_s, falls_s)

    def _trip(self, time_s: float) -> None:
        self._trips_s, self._motor_s, self._zero_s = math.inf, math.inf, None
        brake = STOP_BRAKE * self._table.largest_acceleration
        self._plan.stop(time_s, brake)
        self.rotation.stop(time_s, brake)

    def _plan_deg(self) -> float:
        return self._plan.now_at(self._now())[0]
