"""A ramp of a set-point that the driver steps by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

MOST_AT_ONCE_K = 1.0


@dataclass
class Steps:
    """A ramp that the driver steps by itself: where it began, where it ends, where it stands."""

    start_degC: float
    target_degC: float
    rate_K_per_s: float
    began_s: float
    stands_at_degC: float

    def due_degC(self, time_s: float) -> float:
        """Return where the set-point belongs, at most `MOST_AT_ONCE_K` from where it stands."""
        way = self.target_degC - self.start_degC
        gone = min(self.rate_K_per_s * (time_s - self.began_s), abs(way))
        change = self.start_degC + math.copysign(gone, way) - self.stands_at_degC
        change = max(-MOST_AT_ONCE_K, min(change, MOST_AT_ONCE_K))
        due_degC = self.stands_at_degC + change
        return self.target_degC if math.isclose(due_degC, self.target_degC) else due_degC
