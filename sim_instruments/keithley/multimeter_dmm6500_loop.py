"""When a Keithley DMM6500 measures: the template `SimpleLoop` of its trigger model."""

from __future__ import annotations

import math

import numpy as np

from sim_instruments.keysight.multimeter_34465a_settings import unquoted
from sim_instruments.wire.scpi import ScpiError, number, whole_number
from sim_instruments.world.piecewise import Array

MAX_READINGS = 1_000_000
DELAYS_S = (167e-9, 10e3)
BETWEEN_READINGS_S = 0.2e-3
ROUNDING = 1e-6
"""Of one reading: one that ends at this very moment is finished, whatever the last bit says."""
MEASURES_AT, ENDS_AT = 2, 4


class SimpleLoop:
    """So many readings with a delay before each, from one INIT."""

    def __init__(self) -> None:
        self._loaded = self._planned = self._taken = 0
        self._delay_s = self._begin_s = self._period_s = self._busy_s = 0.0
        self._aborted = False

    @property
    def runs(self) -> bool:
        """Whether it measures."""
        return self._taken < self._planned

    @property
    def end_s(self) -> float:
        """When the last reading is finished."""
        return self._begin_s + (self._planned - 1) * self._period_s + self._busy_s

    @property
    def state(self) -> str:
        """Return what `TRIG:STAT?` answers."""
        if self.runs:
            return f"RUNNING;RUNNING;{MEASURES_AT}"
        if not self._loaded:
            return "EMPTY;EMPTY;0"
        return f"ABORTED;ABORTED;{MEASURES_AT}" if self._aborted else f"IDLE;IDLE;{ENDS_AT}"

    def load(self, parameters: list[str]) -> None:
        """Load `"SimpleLoop",count[,delay[,"defbuffer1"]]` or `"Empty"`."""
        template = unquoted(parameters[0]).lower() if parameters else ""
        if self.runs:
            raise ScpiError(-221)
        if template == "empty" and len(parameters) == 1:
            self._loaded = 0
            return
        if template != "simpleloop":
            raise ScpiError(-224)
        if len(parameters) < 2:
            raise ScpiError(-109)
        if len(parameters) > 4:
            raise ScpiError(-108)
        if len(parameters) == 4 and unquoted(parameters[3]).lower() != "defbuffer1":
            raise ScpiError(-224)
        delay_s = number(parameters[2]) if len(parameters) > 2 else 0.0
        if delay_s and not DELAYS_S[0] <= delay_s <= DELAYS_S[1]:
            raise ScpiError(-222)
        self._loaded = whole_number(parameters[1], 1, MAX_READINGS)
        self._delay_s, self._planned, self._taken = delay_s, 0, 0

    def initiate(self, now_s: float, busy_s: float) -> None:
        """Begin, each reading taking `busy_s`; ScpiError where it runs, or nothing is loaded."""
        if self.runs:
            raise ScpiError(-213)
        if not self._loaded:
            raise ScpiError(-221)
        self._aborted = False
        self._planned, self._taken, self._busy_s = self._loaded, 0, busy_s
        self._period_s = busy_s + self._delay_s + BETWEEN_READINGS_S
        self._begin_s = now_s + self._delay_s

    def abort(self) -> None:
        """Stop; the readings that were taken stay."""
        self._aborted = self._aborted or self.runs
        self._planned = self._taken

    def finished(self, now_s: float) -> Array:
        """Return when the newly finished readings began, shape (readings,)."""
        if not self.runs:
            return np.empty(0)
        ended = (now_s - self._begin_s - self._busy_s) / self._period_s + ROUNDING
        until = max(self._taken, min(math.floor(ended) + 1, self._planned))
        numbers = np.arange(self._taken, until, dtype=np.float64)
        self._taken = until
        return self._begin_s + self._period_s * numbers
