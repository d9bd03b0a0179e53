"""The voltage at one coil over all time: levels that follow each other.

An edge takes a generator nanoseconds; that the current comes later is the coil's doing.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

LONG_AGO_S = -1e6


class VoltageHistory:
    """What one output has given, gives, and will give if nobody intervenes.

    `changed_s` is when somebody last intervened: what lies before it stays as it is.
    """

    def __init__(self) -> None:
        self.changed_s = LONG_AGO_S
        self._times_s = [LONG_AGO_S]
        self._levels_V = [0.0]

    def set(self, time_s: float, level_V: float) -> None:
        """Go to `level_V` at `time_s`, whatever was planned from then on."""
        kept = max(bisect_left(self._times_s, time_s), 1)
        del self._times_s[kept:], self._levels_V[kept:]
        self.changed_s = time_s
        self.then(time_s, level_V)

    def then(self, time_s: float, level_V: float) -> None:
        """Go on to `level_V` at `time_s`, which is later than everything planned before."""
        if level_V != self._levels_V[-1]:
            self._times_s.append(time_s)
            self._levels_V.append(level_V)

    def now_V(self, time_s: float) -> float:
        """Return the voltage at one time, in V."""
        return self._levels_V[max(bisect_right(self._times_s, time_s) - 1, 0)]

    def voltage_V(self, time_s: Array) -> Array:
        """Return the voltage at each time, in V; the shape is that of the times."""
        here = np.searchsorted(np.asarray(self._times_s), time_s, side="right") - 1
        return np.asarray(self._levels_V)[np.maximum(here, 0)]

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return the times between two times at which the level changes, in s."""
        first, last = bisect_right(self._times_s, first_s), bisect_left(self._times_s, last_s)
        return np.array(self._times_s[first:last], dtype=np.float64)
