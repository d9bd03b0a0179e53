"""The messages to one channel of a Keysight 33522B, and what has to read back.

Widths go by way of the shortest, amplitudes by way of the smallest: in whatever order the old and
the new values lie, no setting on the way is in conflict with another, and every error is one.
"""

from __future__ import annotations

import math

from station.units import UnitError, parse_as

CHANNELS = (1, 2)
TRIGGERS = {"external": "EXT", "bus": "BUS"}
HIGH_IMPEDANCE = "high-impedance"
LOADS_OHM = (1.0, 10e3)
OPEN_OHM = 1e30
"""What reads higher is an open end; the instrument says 9.9E+37."""

LARGEST_OPEN_V = 10.0
LEAST_OPEN_VPP = 2e-3
WIDTHS_S = (1e-6, 5e5)
"""It can do shorter ones, which no coil follows."""

PAUSE_SHARE, PAUSE_S = 0.1, 1e-3
"""A period is longer than its pulse; the least difference is 16 ns."""

RELATIVE_TOLERANCE, TOLERANCE = 1e-3, 1e-4
"""Of a read-back: four digits, in V and s, is what the data sheets of the family promise."""


class Messages:
    """The messages of one channel, and the settings to ask for afterwards, by query."""

    def __init__(self, channel: int, trigger: str) -> None:
        self._out, self._trig = f"OUTP{channel}", f"TRIG{channel}"
        self._sour = f"SOUR{channel}"
        self._trigger = trigger
        self.output = f"{self._out}?"

    def switch(self, *, on: bool) -> str:
        """Return what switches the output on or off."""
        return f"{self._out} {'ON' if on else 'OFF'}"

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

    def steady(self) -> str:
        """Return what switches the output off and makes the function DC, at 0 V."""
        return joined(
            self.switch(on=False),
            f"{self._sour}:BURS:STAT OFF",
            f"{self._out}:POL NORM",
            f"{self._sour}:FUNC DC",
            f"{self._sour}:VOLT:OFFS 0",
        )

    def offset(self, voltage_V: float) -> str:
        """Return what sets the steady voltage."""
        return f"{self._sour}:VOLT:OFFS {voltage_V:.7g}"

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
        period_s = duration_s + max(PAUSE_SHARE * duration_s, PAUSE_S)
        pulse, burst = f"{self._sour}:FUNC:PULS", f"{self._sour}:BURS"
        return [
            joined(
                f"{self._sour}:FUNC PULS",
                f"{self._sour}:VOLT:UNIT VPP",
                f"{self._sour}:VOLT MIN",
                f"{self._sour}:VOLT:OFFS {held_V + step_V / 2:.7g}",
                f"{self._sour}:VOLT {abs(step_V):.7g}",
                f"{self._out}:POL {'NORM' if step_V > 0 else 'INV'}",
            ),
            joined(
                f"{pulse}:HOLD WIDT",
                f"{pulse}:WIDT MIN",
                f"{pulse}:PER {period_s:.9g}",
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


def joined(*commands: str) -> str:
    """Return one message of several commands, each from the root."""
    return ";:".join(commands)


def load_of(given: str) -> str:
    """Return what outputs are connected to, checked; raise ValueError for what is none."""
    if given != HIGH_IMPEDANCE:
        try:
            ohm = parse_as(given, "ohm")
        except UnitError as error:
            raise ValueError(f"must be {HIGH_IMPEDANCE}, or a resistance: {error}") from error
        if not LOADS_OHM[0] <= ohm <= LOADS_OHM[1]:
            raise ValueError(f"must be 1 ohm to 10000 ohm, or {HIGH_IMPEDANCE}, not {given}")
    return given


def load_ohm(load: str) -> float:
    """Return what outputs are connected to in ohm, infinite if open."""
    return math.inf if load == HIGH_IMPEDANCE else parse_as(load, "ohm")


def differs(expected: str | float, answer: str) -> bool:
    """Return whether an answer is not what was expected; an infinite number is an open end."""
    if isinstance(expected, str):
        return answer.strip() != expected
    try:
        value = float(answer)
    except ValueError:
        return True
    if math.isinf(expected):
        return not value > OPEN_OHM
    return not abs(value - expected) <= RELATIVE_TOLERANCE * abs(expected) + TOLERANCE
