"""The angle of one axis over all time, known exactly and evaluated when somebody looks.

The axis moves in stretches of constant acceleration, so its angle is a parabola in pieces: no
numerical integration, and the past stays as it was however late it is looked at. A rotary stage
goes from angle to angle (`move_to`), a rate table keeps turning (`turn_at`). What is kept is where
the axis truly is; what an encoder says of it belongs to the instrument that has the encoder.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable

import numpy as np

from sim_instruments.world.piecewise import LONG_AGO_S, Array, Rows


def ignore_change() -> None:
    """Do nothing on a change."""


class RotationHistory:
    """One axis, at rest at `angle_deg` until it is commanded to move; angles are not wrapped.

    Every command takes the time from which it holds and replaces what was planned after it; a
    time before the last command's counts as that. `changed` is called after each.
    """

    def __init__(self, angle_deg: float = 0.0, changed: Callable[[], None] = ignore_change) -> None:
        self._changed = changed
        self._start_s = [LONG_AGO_S]
        self._angle = [angle_deg]
        self._rate = [0.0]
        self._acceleration = [0.0]
        self._commanded_s = LONG_AGO_S
        self._braking = math.inf
        # The same again, for many times at once.
        self._rows = Rows(4)
        self._rows.add(LONG_AGO_S, angle_deg, 0.0, 0.0)

    def angle_deg(self, time_s: Array) -> Array:
        """Return the angle at each time, same shape, in deg."""
        since_s, angle, rate, acceleration = self._at(time_s)
        return np.asarray(angle + (rate + 0.5 * acceleration * since_s) * since_s)

    def rate_deg_per_s(self, time_s: Array) -> Array:
        """Return the rate at each time, same shape, in deg/s."""
        since_s, _, rate, acceleration = self._at(time_s)
        return np.asarray(rate + acceleration * since_s)

    def now_at(self, time_s: float) -> tuple[float, float]:
        """Return angle in deg and rate in deg/s at one time, faster than by arrays."""
        k = max(bisect_right(self._start_s, time_s) - 1, 0)
        since_s, rate = time_s - self._start_s[k], self._rate[k]
        acceleration = self._acceleration[k]
        angle = self._angle[k] + (rate + 0.5 * acceleration * since_s) * since_s
        return angle, rate + acceleration * since_s

    def angle_and_rate(self, time_s: Array) -> tuple[Array, Array]:
        """Return angle (deg) and rate (deg/s) at each time, looked up once."""
        since_s, angle, rate, acceleration = self._at(time_s)
        gained = acceleration * since_s
        return angle + (rate + 0.5 * gained) * since_s, rate + gained

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return the times between two others at which the acceleration changes."""
        starts = self._rows.first
        first, last = starts.searchsorted(first_s, side="right"), starts.searchsorted(last_s)
        return starts[first:last]

    @property
    def commanded_s(self) -> float:
        """The time from which the last command holds; before it nothing changes any more."""
        return self._commanded_s

    @property
    def at_rest_from_s(self) -> float:
        """The time from which the axis stands still as it was commanded; infinite if it never."""
        still = self._rate[-1] == 0.0 and self._acceleration[-1] == 0.0
        return self._start_s[-1] if still else math.inf

    def put(self, time_s: float, angle_deg: float) -> None:
        """Be at another angle, at rest, as after a person turned the axis by hand."""
        self._cut(time_s)
        self._add(self._commanded_s, angle_deg, 0.0, 0.0)
        self._changed()

    def move_to(
        self,
        time_s: float,
        target_deg: float,
        rate_deg_per_s: float,
        acceleration_deg_per_s2: float,
        deceleration_deg_per_s2: float | None = None,
    ) -> float:
        """Turn to an angle by the shortest profile within the limits; return when it stands there.

        Without a deceleration the axis brakes as it accelerates. A movement under way is taken
        over as it is, turned back where it would run past the target.
        """
        speed_up, brake = acceleration_deg_per_s2, deceleration_deg_per_s2
        self._braking = brake = speed_up if brake is None else brake
        now_s, angle, rate = self._cut(time_s)
        stopped_deg = angle + rate * abs(rate) / (2 * brake)
        sense = math.copysign(1.0, target_deg - stopped_deg)
        if rate * sense < 0 or target_deg == stopped_deg:
            now_s, angle, rate = self._ramp(now_s, angle, rate, 0.0, brake)
            sense = math.copysign(1.0, target_deg - angle)
        distance, along = abs(target_deg - angle), abs(rate)
        if distance > 0.0:
            reachable = math.sqrt(brake * (2 * speed_up * distance + along**2) / (speed_up + brake))
            top = min(rate_deg_per_s, reachable)
            if along > top:
                now_s, angle, rate = self._ramp(now_s, angle, rate, sense * top, brake)
            elif along < top:
                now_s, angle, rate = self._ramp(now_s, angle, rate, sense * top, speed_up)
            left = abs(target_deg - angle) - top**2 / (2 * brake)
            if left > 0.0:
                self._add(now_s, angle, rate, 0.0)
                now_s, angle = now_s + left / top, angle + sense * left
            now_s, _, _ = self._ramp(now_s, angle, rate, 0.0, brake)
        # Exactly there: what rounding left over would stay for ever.
        self._add(now_s, target_deg, 0.0, 0.0)
        self._changed()
        return now_s

    def turn_at(
        self, time_s: float, rate_deg_per_s: float, acceleration_deg_per_s2: float
    ) -> float:
        """Go to a rate and keep it; return when it is reached."""
        self._braking = acceleration_deg_per_s2
        now_s, angle, rate = self._cut(time_s)
        now_s, angle, _ = self._ramp(now_s, angle, rate, rate_deg_per_s, acceleration_deg_per_s2)
        self._add(now_s, angle, rate_deg_per_s, 0.0)
        self._changed()
        return now_s

    def stop(self, time_s: float, deceleration_deg_per_s2: float | None = None) -> float:
        """Brake to rest, without a deceleration as in the last movement; return when it stands."""
        brake = self._braking if deceleration_deg_per_s2 is None else deceleration_deg_per_s2
        now_s, angle, rate = self._cut(time_s)
        if math.isfinite(brake):
            now_s, angle, _ = self._ramp(now_s, angle, rate, 0.0, brake)
        self._add(now_s, angle, 0.0, 0.0)
        self._changed()
        return now_s

    def halt(self, time_s: float) -> None:
        """Stand still at once, as an axis that is blocked."""
        self.stop(time_s, math.inf)

    def _cut(self, time_s: float) -> tuple[float, float, float]:
        """Forget what was planned from a time on; return that time, angle and rate there."""
        self._commanded_s = now_s = max(time_s, self._commanded_s)
        angle, rate = self.now_at(now_s)
        keep = max(bisect_left(self._start_s, now_s), 1)
        for column in (self._start_s, self._angle, self._rate, self._acceleration):
            del column[keep:]
        self._rows.cut(keep)
        return now_s, angle, rate

    def _ramp(
        self, start_s: float, angle: float, rate: float, to_rate: float, acceleration: float
    ) -> tuple[float, float, float]:
        """Add a stretch from one rate to another; return its end, angle and rate there."""
        takes_s = abs(to_rate - rate) / acceleration
        if takes_s > 0.0:
            self._add(start_s, angle, rate, math.copysign(acceleration, to_rate - rate))
        return start_s + takes_s, angle + 0.5 * (rate + to_rate) * takes_s, to_rate

    def _add(self, start_s: float, angle: float, rate: float, acceleration: float) -> None:
        self._start_s.append(start_s)
        self._angle.append(angle)
        self._rate.append(rate)
        self._acceleration.append(acceleration)
        self._rows.add(start_s, angle, rate, acceleration)

    def _at(self, time_s: Array) -> tuple[Array, Array, Array, Array]:
        row = self._rows.all[self._rows.at(time_s)]
        return time_s - row[..., 0], row[..., 1], row[..., 2], row[..., 3]
