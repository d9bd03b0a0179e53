"""When a Keysight 34465A measures: TRIG and SAMP.

From the Truevolt guide and public client code: `INITiate` leaves idle and forgets older readings,
each trigger starts `SAMPle:COUNt` readings, after `TRIGger:COUNt` triggers it is idle again, the
trigger delay comes before every reading, or before the first one only where a sample timer paces
them. Assumed: the automatic delay, and what the instrument needs between two readings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from sim_instruments.generic.burst import BETWEEN_READINGS_S, Burst
from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    choice,
    numeric,
    single_parameter,
    within,
    word,
    words,
)
from sim_instruments.wire.scpi import whole_number as whole
from sim_instruments.wire.scpi_device import Listed, Value

MAX_SAMPLES = 1_000_000_000
AUTOMATIC_DELAY_S = 1e-3


class TriggerSystem(Burst):
    """When readings begin; `reset` gives the state after `*RST`."""

    def __init__(self) -> None:
        super().__init__()
        self.reset()

    def reset(self) -> None:
        """Go idle, one reading for one trigger that is always there."""
        self.source, self.slope, self.level_V = "IMM", "NEG", 0.0
        self.triggers = 1.0
        self.samples = 1
        self.delay_s: float | None = None
        self.timed, self.timer_s, self.before = False, 1.0, 0
        self.stop()

    def stop(self) -> None:
        """Go idle."""
        self._triggers_left = 0.0
        super().stop()

    @property
    def waiting(self) -> bool:
        """Whether a trigger is waited for."""
        return not self.runs and self._triggers_left > 0

    @property
    def idle(self) -> bool:
        """Whether nothing is measured and nothing waited for."""
        return not self.runs and not self._triggers_left

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
        if self.source == "IMM":
            self._triggers_left = 0.0
            self._begin(now_s, self.samples * int(min(self.triggers, MAX_SAMPLES)))

    def trigger(self, now_s: float) -> None:
        """Take a trigger over the line; ScpiError -211 when none is waited for."""
        if self.source != "BUS" or not self.waiting:
            raise ScpiError(-211)
        self._triggers_left -= 1
        self._begin(now_s, self.samples)

    def _begin(self, now_s: float, readings: int) -> None:
        period_s = self.least_period_s(self._busy_s)
        period_s = max(period_s, self.timer_s) if self.timed else period_s
        self.start(readings, now_s + self.pause_s(), period_s, self._busy_s)


def trigger_commands(
    trigger: TriggerSystem, least_period_s: Callable[[], float]
) -> dict[str, Value]:
    """Return the commands TRIGger and SAMPle."""

    def row(name: str, read: Callable[[str], Any], give: Callable[[], str]) -> Listed:
        return Listed(
            lambda given: setattr(trigger, name, read(single_parameter(given))), lambda _: give()
        )

    def count(text: str) -> int:
        return round(numeric(text, 1, MAX_SAMPLES, 1))

    def many(text: str) -> float:
        return math.inf if text.upper() in ("INF", "INFINITY") else count(text)

    def delay(text: str) -> float | None:
        return None if boolean(text) else trigger.pause_s()

    def interval(text: str) -> float:
        return numeric(text, min(least_period_s(), 3600.0), 3600.0, 1.0)

    def paced(text: str) -> bool:
        return choice(text, words("IMMediate", "TIMer")) == "TIM"

    sources, slopes = word("IMMediate", "BUS", "EXTernal", "INTernal"), word("POSitive", "NEGative")
    level, pause = within(-1000.0, 1000.0, 0.0), within(0.0, 3600.0, 1.0)
    return {
        "TRIGger:SOURce": row("source", sources, lambda: trigger.source),
        "TRIGger:SLOPe": row("slope", slopes, lambda: trigger.slope),
        "TRIGger:LEVel": row("level_V", level, lambda: f"{trigger.level_V:+.8E}"),
        "TRIGger:COUNt": row("triggers", many, lambda: f"{min(trigger.triggers, 9.9e37):+.8E}"),
        "TRIGger:DELay": row("delay_s", pause, lambda: f"{trigger.pause_s():+.8E}"),
        "TRIGger:DELay:AUTO": row("delay_s", delay, lambda: str(int(trigger.delay_s is None))),
        "SAMPle:COUNt": row("samples", count, lambda: f"{trigger.samples:+d}"),
        "SAMPle:COUNt:PRETrigger": row("before", lambda text: whole(text, 0, 0), lambda: "+0"),
        "SAMPle:SOURce": row("timed", paced, lambda: "TIM" if trigger.timed else "IMM"),
        "SAMPle:TIMer": Listed(
            lambda given: setattr(trigger, "timer_s", interval(single_parameter(given))),
            lambda given: f"{interval(given[0]) if given else trigger.timer_s:+.8E}",
        ),
    }
