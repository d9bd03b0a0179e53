"""Readings that a meter takes one after another, and when each is finished."""

from __future__ import annotations

import math

import numpy as np

from sim_instruments.world.piecewise import Array

BETWEEN_READINGS_S = 0.2e-3
"""What a meter needs between two readings: assumed."""

ROUNDING = 1e-6
"""Of one reading: one that ends at this very moment is finished, whatever the last bit says."""


class Burst:
    """So many readings with the same time between them, each taking `busy_s`."""

    def __init__(self) -> None:
        self.start(0, 0.0, 0.0, 0.0)

    def start(self, readings: int, begin_s: float, period_s: float, busy_s: float) -> None:
        """Begin, whatever there was before."""
        self._planned, self._taken = readings, 0
        self._begin_s, self._period_s, self._busy_s = begin_s, period_s, busy_s

    def stop(self) -> None:
        """Take no more readings."""
        self._planned = self._taken

    @property
    def runs(self) -> bool:
        """Whether there are readings to come."""
        return self._taken < self._planned

    @property
    def end_s(self) -> float:
        """When the last reading is finished."""
        return self._begin_s + (self._planned - 1) * self._period_s + self._busy_s

    def finished(self, now_s: float, most: int) -> Array:
        """Return when the newly finished readings began, the last ones where there are too many."""
        if not self.runs:
            return np.empty(0)
        ended = math.floor((now_s - self._begin_s - self._busy_s) / self._period_s + ROUNDING) + 1
        until = max(self._taken, min(ended, self._planned))
        first, self._taken = max(self._taken, until - most), until
        return self._begin_s + self._period_s * np.arange(first, until, dtype=np.float64)
