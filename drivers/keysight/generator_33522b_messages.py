"""The messages to one channel of a Keysight 33522B, and what has to read back.

Widths go by way of the shortest, amplitudes by way of the smallest: in whatever order the old and
the new values lie, no setting on the way is in conflict with another, and every error is one.
"""

from __future__ import annotations

import math

from drivers.generic.coil_generator_messages import ChannelMessages, joined, period_of

TRIGGERS = {"external": "EXT", "bus": "BUS"}


class Messages(ChannelMessages):
    """The messages of one channel, and the settings to ask for afterwards, by query."""

    def __init__(self, channel: int, trigger: str) -> None:
        super().__init__(channel)
        self._trig, self._trigger = f"TRIG{channel}", trigger

    def limits(self, load_ohm: float, limit_V: float) -> str:
        """Return what sets the termination and the voltage limits, with the function at 0 V."""
        load = "INF" if math.isinf(load_ohm) else f"{load_ohm:g}"
        return joined(
            f"{self._sour}:VOLT:LIM:STAT OFF",
            f"{self._out}:LOAD {load}",
            f"{self._sour}:FUNC DC",
            f"{self._sour}:VOLT:OFFS 0",
            f"{self._sour}:VOLT:LIM:HIGH {limit_V:.6g}",
            f"{self._sour}:VOLT:LIM:LOW {-limit_V:.6g}",
            f"{self._sour}:VOLT:LIM:STAT ON",
        )

    def limited(self, load_ohm: float, limit_V: float) -> dict[str, str | float]:
        """Return what has to be read after the limits were set."""
        return {
            f"{self._out}:LOAD?": load_ohm,
            f"{self._sour}:VOLT:LIM:STAT?": "1",
            f"{self._sour}:VOLT:LIM:HIGH?": limit_V,
            f"{self._sour}:VOLT:LIM:LOW?": -limit_V,
            self.output: "0",
        }

    def held(self, load_ohm: float, voltage_V: float) -> dict[str, str | float]:
        """Return what has to be read of a channel that holds a voltage."""
        return {
            f"{self._sour}:FUNC?": "DC",
            f"{self._sour}:VOLT:OFFS?": voltage_V,
            f"{self._out}:LOAD?": load_ohm,
            self.output: "1",
        }

    def step(
        self, held_V: float, step_V: float, duration_s: float, delay_s: float = 0.0
    ) -> list[str]:
        """Return what turns a steady channel, its output off, into one that waits for a trigger."""
        pulse, burst = f"{self._sour}:FUNC:PULS", f"{self._sour}:BURS"
        return [
            self.levels(held_V, step_V),
            joined(
                f"{pulse}:HOLD WIDT",
                f"{pulse}:WIDT MIN",
                f"{pulse}:PER {period_of(duration_s):.9g}",
                f"{pulse}:WIDT {duration_s:.9g}",
            ),
            joined(
                f"{self._trig}:SOUR {self._trigger}",
                f"{self._trig}:SLOP POS",
                f"{self._trig}:DEL {delay_s:.9g}",
                f"{burst}:MODE TRIG",
                f"{burst}:NCYC 1",
                f"{burst}:STAT ON",
            ),
        ]

    def stepping(
        self,
        load_ohm: float,
        held_V: float,
        step_V: float,
        duration_s: float,
        delay_s: float = 0.0,
    ) -> dict[str, str | float]:
        """Return what has to be read of a channel that waits for a trigger."""
        return {
            f"{self._sour}:FUNC?": "PULS",
            f"{self._sour}:VOLT:LOW?": min(held_V, held_V + step_V),
            f"{self._sour}:VOLT:HIGH?": max(held_V, held_V + step_V),
            f"{self._sour}:FUNC:PULS:WIDT?": duration_s,
            f"{self._out}:POL?": "NORM" if step_V > 0 else "INV",
            f"{self._out}:LOAD?": load_ohm,
            f"{self._sour}:BURS:STAT?": "1",
            f"{self._sour}:BURS:NCYC?": 1.0,
            f"{self._trig}:SOUR?": self._trigger,
            f"{self._trig}:DEL?": delay_s,
            self.output: "1",
        }
