"""The voltage at one coil over all time: levels that follow each other, each with its rise."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

LONG_AGO_S = -1e6


class VoltageHistory:
    """What one output has given, gives, and will give if nobody intervenes.

    Each level is approached with the time constant `rise_s`; 0: at once. `changed_s` is when
    somebody last intervened: what lies before it stays as it is.
    """

    def __init__(self, rise_s: float = 0.0) -> None:
        self.rise_s = rise_s
        self.changed_s = LONG_AGO_S
        self._times_s = [LONG_AGO_S]
        self._levels_V = [0.0]
        self._begins_V = [0.0]
        """The voltage at the moment at which each level is set."""

    def set(self, time_s: float, level_V: float) -> None:
        """Go to `level_V` at `time_s`, whatever was planned from then on."""
        kept = max(bisect_left(self._times_s, time_s), 1)
        for one in (self._times_s, self._levels_V, self._begins_V):
            del one[kept:]
        self.changed_s = time_s
        self.then(time_s, level_V)

    def then(self, time_s: float, level_V: float) -> None:
        """Go on to `level_V` at `time_s`, which is later than everything planned before."""
        if level_V == self._levels_V[-1]:
            return
        self._begins_V.append(self.now_V(time_s))
        self._times_s.append(time_s)
        self._levels_V.append(level_V)

    def now_V(self, time_s: float) -> float:
        """Return the voltage at one time, in V."""
        here = max(bisect_right(self._times_s, time_s) - 1, 0)
        level_V, begin_V = self._levels_V[here], self._begins_V[here]
        if self.rise_s <= 0.0:
            return level_V
        since_s = time_s - self._times_s[here]
        return level_V + (begin_V - level_V) * math.exp(-max(since_s, 0.0) / self.rise_s)

    def voltage_V(self, time_s: Array) -> Array:
        """Return the voltage at each time, in V; the shape is that of the times."""
        times_s = np.asarray(self._times_s)
        here = np.maximum(np.searchsorted(times_s, time_s, side="right") - 1, 0)
        levels_V = np.asarray(self._levels_V)[here]
        if self.rise_s <= 0.0:
            return levels_V
        since_s = np.maximum(time_s - times_s[here], 0.0)
        distance_V = np.asarray(self._begins_V)[here] - levels_V
        return np.asarray(levels_V + distance_V * np.exp(-since_s / self.rise_s))

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return the times between two times at which the level changes, in s."""
        first, last = bisect_right(self._times_s, first_s), bisect_left(self._times_s, last_s)
        return np.array(self._times_s[first:last])
