"""One capture of a Red Pitaya: which value is taken when, and where it lies in the ring."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sim_instruments.world.piecewise import Array

Numbers = npt.NDArray[np.int64]

CONVERTER_HZ = 125e6
SLOTS = 16384
SYNCHRONISED_S = 5 / CONVERTER_HZ
"""From an edge at the input to the trigger: three clocks to synchronise it, two to make it one."""


@dataclass
class Capture:
    """One capture, from its arming on; values are numbered from 0, number 0 lies in `first_slot`.

    `delay` counts the values that are stored after the trigger. `stopped_s`: it must stop then.
    """

    began_s: float
    interval_s: float
    first_slot: int
    delay: int
    triggered_at: int | None = None
    stopped_s: float = math.inf

    def number_at(self, time_s: float) -> int:
        """Return the number of the value that is being taken at a time."""
        return math.floor((min(time_s, self.stopped_s) - self.began_s) / self.interval_s + 1e-9)

    def last_at(self, time_s: float) -> int:
        """Return the number of the last value that is stored at a time; -1 for none."""
        last = self.number_at(time_s) - 1
        return last if self.triggered_at is None else min(last, self.last_of_all)

    @property
    def last_of_all(self) -> int:
        """The number of the value with which a triggered capture ends."""
        assert self.triggered_at is not None
        return self.triggered_at + max(self.delay, 1) - 1

    def is_full(self, time_s: float) -> bool:
        """Return whether it was triggered and its delay is over."""
        return self.triggered_at is not None and self.last_at(time_s) >= self.last_of_all

    def trigger(self, time_s: float) -> None:
        """Take an edge at the input; only the first counts."""
        if self.triggered_at is None and time_s <= self.stopped_s:
            self.triggered_at = self.number_at(time_s + SYNCHRONISED_S)

    def slot(self, number: int) -> int:
        """Return where a value lies in the ring."""
        return (self.first_slot + number) % SLOTS

    def numbers(self, start: int, count: int, now_s: float) -> Numbers:
        """Return the numbers of the values in `count` slots from `start` on; negative for none."""
        last = self.last_at(now_s)
        slots = (start + np.arange(count)) % SLOTS
        return np.asarray(last - (self.slot(last) - slots) % SLOTS)

    def middles_s(self, numbers: Numbers) -> Array:
        """Return the times in the middle of values."""
        return np.asarray(self.began_s + (numbers + 0.5) * self.interval_s)
