"""The trigger system of a Keysight 34465A: idle, waiting for a trigger, measuring.

From the Truevolt guide: `INITiate` leaves idle and forgets older readings, each trigger starts
`SAMPle:COUNt` readings, after `TRIGger:COUNt` triggers it is idle again, the trigger delay comes
before every reading, or before the first one only where a sample timer paces them. Assumed: the
automatic delay, and what the instrument needs between two readings.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from sim_instruments.scpi import ScpiError

Array = npt.NDArray[np.float64]

MOST_SAMPLES = 1_000_000_000
AUTOMATIC_DELAY_S = 1e-3
BETWEEN_READINGS_S = 0.2e-3
ROUNDING = 1e-6
"""Of one reading: one that ends at this very moment is finished, whatever the last bit says."""


class TriggerSystem:
    """When readings begin; `reset` gives the state after `*RST`."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Go idle, one reading for one trigger that is always there."""
        self.source, self.slope, self.level_V = "IMM", "NEG", 0.0
        self.triggers = 1.0
        self.samples = 1
        self.delay_s: float | None = None
        self.timed, self.timer_s = False, 1.0
        self.abort()

    def abort(self) -> None:
        """Go idle."""
        self._triggers_left = 0.0
        self._planned = self._taken = 0
        self._begin_s = self._period_s = self._busy_s = 0.0

    @property
    def waiting(self) -> bool:
        """Whether a trigger is waited for."""
        return self._taken == self._planned and self._triggers_left > 0

    @property
    def idle(self) -> bool:
        """Whether nothing is measured and nothing waited for."""
        return self._taken == self._planned and not self._triggers_left

    @property
    def end_s(self) -> float:
        """When the readings of the present trigger are finished."""
        return self._begin_s + (self._planned - 1) * self._period_s + self._busy_s

    def pause_s(self) -> float:
        """Return the delay before a reading."""
        return AUTOMATIC_DELAY_S if self.delay_s is None else self.delay_s

    def least_period_s(self, busy_s: float) -> float:
        """Return the shortest time from reading to reading, each taking `busy_s`."""
        return busy_s + BETWEEN_READINGS_S + (0.0 if self.timed else self.pause_s())

    def initiate(self, now_s: float, busy_s: float) -> None:
        """Leave idle; ScpiError -213 when it is not idle."""
        if not self.idle:
            raise ScpiError(-213)
        self._busy_s = busy_s
        self._triggers_left = self.triggers
        self._planned = self._taken = 0
        if self.source == "IMM":
            at_once = min(self.triggers, MOST_SAMPLES)
            self._triggers_left = 0.0
            self._start(now_s, self.samples * int(at_once))

    def trigger(self, now_s: float) -> None:
        """Take a trigger over the line; ScpiError -211 when none is waited for."""
        if self.source != "BUS" or not self.waiting:
            raise ScpiError(-211)
        self._triggers_left -= 1
        self._start(now_s, self.samples)

    def finished(self, now_s: float, room: int) -> tuple[Array, int]:
        """Return when the newly finished readings began, and how many there are in all.

        Of more than `room` only the last ones are told.
        """
        new = 0
        if self._taken < self._planned:
            ended = (now_s - self._begin_s - self._busy_s) / self._period_s + ROUNDING
            new = min(math.floor(ended) + 1, self._planned) - self._taken
        if new <= 0:
            return np.empty(0), 0
        self._taken += new
        first = self._taken - min(new, room)
        return self._begin_s + self._period_s * np.arange(first, self._taken), new

    def _start(self, now_s: float, readings: int) -> None:
        self._begin_s = now_s + self.pause_s()
        period_s = self.least_period_s(self._busy_s)
        self._period_s = max(period_s, self.timer_s) if self.timed else period_s
        self._planned, self._taken = readings, 0
