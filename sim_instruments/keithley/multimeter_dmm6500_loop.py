"""When a Keithley DMM6500 measures: READ?, and two templates of its trigger model.

From public notes that quote the manual DMM6500-901-01: `SimpleLoop` (13-267) and `DurationLoop`
(13-260, 500 ns to 100 ks), each with a delay of 167 ns to 10 ks before each reading and a buffer.
"""

from __future__ import annotations

from collections.abc import Callable

from sim_instruments.generic.burst import Burst
from sim_instruments.keithley.multimeter_dmm6500_buffers import FIRST
from sim_instruments.wire.scpi import ScpiError, number, unquoted, whole_number

MAX_READINGS = 1_000_000
DELAYS_S, DURATIONS_S = (167e-9, 10e3), (500e-9, 100e3)
MEASURES_AT, ENDS_AT = 2, 4


class SimpleLoop(Burst):
    """So many readings, or readings for so long, with a delay before each, from one INIT.

    `known` checks the name of a buffer, which stands between quotes.
    """

    def __init__(self, known: Callable[[list[str]], object]) -> None:
        self._aborted = False
        super().__init__()
        self._known = known
        self.reset()

    def reset(self) -> None:
        """Have nothing loaded."""
        self.stop()
        self._count, self._duration_s, self._delay_s = 0, 0.0, 0.0
        self._aborted = self._loaded = False
        self.buffer = [f'"{FIRST}"']

    @property
    def state(self) -> str:
        """Return what `TRIG:STAT?` answers."""
        if self.runs:
            return f"RUNNING;RUNNING;{MEASURES_AT}"
        if not self._loaded:
            return "EMPTY;EMPTY;0"
        return f"ABORTED;ABORTED;{MEASURES_AT}" if self._aborted else f"IDLE;IDLE;{ENDS_AT}"

    def load(self, parameters: list[str]) -> None:
        """Load `"SimpleLoop",count[,delay[,buffer]]`, `"DurationLoop",s[,…]` or `"Empty"`."""
        template = unquoted(parameters[0]).lower() if parameters else ""
        if self.runs:
            raise ScpiError(-221)
        if template == "empty" and len(parameters) == 1:
            self._loaded = False
            return
        if template not in ("simpleloop", "durationloop"):
            raise ScpiError(-224)
        if len(parameters) < 2:
            raise ScpiError(-109)
        if len(parameters) > 4:
            raise ScpiError(-108)
        self._known(parameters[3:])
        delay_s = number(parameters[2]) if len(parameters) > 2 else 0.0
        if delay_s and not DELAYS_S[0] <= delay_s <= DELAYS_S[1]:
            raise ScpiError(-222)
        if template == "simpleloop":
            self._count, self._duration_s = whole_number(parameters[1], 1, MAX_READINGS), 0.0
        else:
            self._count, self._duration_s = 0, number(parameters[1])
            if not DURATIONS_S[0] <= self._duration_s <= DURATIONS_S[1]:
                raise ScpiError(-222)
        self._loaded, self._delay_s = True, delay_s
        self._into = parameters[3:] or [f'"{FIRST}"']

    def initiate(self, now_s: float, busy_s: float, pause_s: float) -> None:
        """Begin, each reading taking `busy_s`; ScpiError where it runs, or nothing is loaded."""
        if self.runs:
            raise ScpiError(-213)
        if not self._loaded:
            raise ScpiError(-221)
        self._aborted, self.buffer = False, self._into
        period_s = busy_s + self._delay_s + pause_s
        count = self._count or max(1, int(self._duration_s / period_s))
        self.start(count, now_s + self._delay_s, period_s, busy_s)

    def measure(
        self, count: int, buffer: list[str], now_s: float, busy_s: float, pause_s: float
    ) -> None:
        """Take readings at once, whatever is loaded; ScpiError where it runs."""
        if self.runs:
            raise ScpiError(-213)
        self._known(buffer)
        self.buffer = buffer
        self.start(count, now_s, busy_s + pause_s, busy_s)

    def stop(self) -> None:
        """Stop; the readings that were taken stay."""
        self._aborted = self._aborted or self.runs
        super().stop()
