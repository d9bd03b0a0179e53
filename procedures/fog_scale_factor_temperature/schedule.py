"""How long a set of turns takes, and whether it fits between one set and the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

FULL_TURN_DEG = 360.0


@dataclass(frozen=True)
class Schedule:
    """A set: each axis is turned up, then makes its turns, from rest to rest.

    `turns` are those about one axis; the table settles before and after each, pauses between them.
    """

    interval_s: float
    axes: int
    turns: int
    settle_s: float
    pause_s: float
    reorientation_s: float
    rate_deg_per_s: float
    acceleration_deg_per_s2: float

    @property
    def motion_s(self) -> float:
        """The time that the table turns in one turn."""
        return motion_s(self.rate_deg_per_s, self.acceleration_deg_per_s2)

    @property
    def turn_s(self) -> float:
        """The time from the reading before a turn to the reading after it."""
        return self.motion_s + 2.0 * self.settle_s

    @property
    def axis_s(self) -> float:
        """The time for all turns about one axis, its way up included."""
        return self.reorientation_s + self.turns * self.turn_s + (self.turns - 1) * self.pause_s

    @property
    def set_s(self) -> float:
        """The time for all axes."""
        return self.axes * self.axis_s

    @property
    def fits(self) -> bool:
        """Whether a set ends before the next begins."""
        return self.set_s <= self.interval_s

    def rate_that_fits(self) -> float | None:
        """Return the least rate in deg/s, rounded up, at which a set fits; None where none does."""
        rest_s = self.reorientation_s + (self.turns - 1) * self.pause_s
        rest_s += 2.0 * self.turns * self.settle_s
        motion = (self.interval_s / self.axes - rest_s) / self.turns
        acceleration = self.acceleration_deg_per_s2
        inside = motion**2 - 4.0 * FULL_TURN_DEG / acceleration
        if motion <= 0.0 or inside < 0.0:
            return None
        least = acceleration * (motion - math.sqrt(inside)) / 2.0
        rounded = math.ceil(least - 1e-9)
        return float(rounded) if motion_s(rounded, acceleration) <= motion else least


def motion_s(rate_deg_per_s: float, acceleration_deg_per_s2: float) -> float:
    """Return the time of a full turn from rest to rest: up to rate, on, and down again."""
    top = min(rate_deg_per_s, math.sqrt(FULL_TURN_DEG * acceleration_deg_per_s2))
    return FULL_TURN_DEG / top + top / acceleration_deg_per_s2
