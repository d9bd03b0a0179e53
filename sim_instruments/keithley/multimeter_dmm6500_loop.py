"""When a Keithley DMM6500 measures: the template `SimpleLoop` of its trigger model."""

from __future__ import annotations

from sim_instruments.generic.burst import BETWEEN_READINGS_S, Burst
from sim_instruments.wire.scpi import ScpiError, number, unquoted, whole_number

MAX_READINGS = 1_000_000
DELAYS_S = (167e-9, 10e3)
MEASURES_AT, ENDS_AT = 2, 4


class SimpleLoop(Burst):
    """So many readings with a delay before each, from one INIT."""

    def __init__(self) -> None:
        super().__init__()
        self._loaded, self._delay_s, self._aborted = 0, 0.0, False

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
        self._delay_s = delay_s

    def initiate(self, now_s: float, busy_s: float) -> None:
        """Begin, each reading taking `busy_s`; ScpiError where it runs, or nothing is loaded."""
        if self.runs:
            raise ScpiError(-213)
        if not self._loaded:
            raise ScpiError(-221)
        self._aborted = False
        period_s = busy_s + self._delay_s + BETWEEN_READINGS_S
        self.start(self._loaded, now_s + self._delay_s, period_s, busy_s)

    def stop(self) -> None:
        """Stop; the readings that were taken stay."""
        self._aborted = self._aborted or self.runs
        super().stop()
