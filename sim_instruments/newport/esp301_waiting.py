"""The waits of a Newport ESP301: what of its input waits for a stop of the axis, or for a time."""

from __future__ import annotations

from sim_instruments.newport.esp301_axis import Axis

LOOK_S = 0.1
"""How long a look at a movement holds good: a trip or an emergency stop ends it early."""


class Waiting:
    """Whether the controller takes its input, by the time `now_s` of each call."""

    def __init__(self, axis: Axis) -> None:
        self._axis = axis
        self._until_s = 0.0
        self._after_stop_s: float | None = None

    def for_time(self, now_s: float, wait_s: float) -> None:
        """Take nothing more for a time (WT)."""
        self._until_s = now_s + wait_s

    def for_stop(self, wait_s: float) -> None:
        """Take nothing more until the movement is over, and for a time after it (WS)."""
        self._after_stop_s = wait_s

    def left_s(self, now_s: float) -> float:
        """Return for how long nothing is taken, 0 or less where it is taken now."""
        if self._after_stop_s is not None:
            self._axis.catch_up()
            moves_s = self._axis.moves_s()
            if moves_s > 0:
                return min(moves_s, LOOK_S)
            self._until_s, self._after_stop_s = now_s + self._after_stop_s, None
        return self._until_s - now_s
