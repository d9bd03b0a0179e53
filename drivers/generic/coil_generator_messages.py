"""What two-output generators at coils are sent, by channel, and what reads back."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from station.units import UnitError, parse_as

HIGH_IMPEDANCE = "high-impedance"
LOADS_OHM = (1.0, 10e3)
OPEN_OHM = 1e30
"""What reads higher is an open end; instruments say 9.9E+37."""

PAUSE_SHARE, PAUSE_S = 0.1, 1e-3
"""A period is longer than its pulse by so much."""

RELATIVE_TOLERANCE, TOLERANCE = 1e-3, 1e-4
"""Of a read-back: four digits, in V and s, is what data sheets promise."""

Wanted = dict[str, str | float]


class ChannelMessages(ABC):
    """The messages of one channel, and the settings to ask for afterwards, by query.

    Widths go by way of the shortest: in whatever order the old and the new values lie, no setting
    on the way is in conflict with another, and every error is one. A model says what its limits of
    voltage are called (`limit`, and what switches them), and how it waits for a trigger.
    """

    on, off = "1", "0"
    """What queries answer about what is on, and what is off."""
    before_width: tuple[str, ...] = ()
    """What the pulse is told before its width."""
    limit: str
    limit_switch: str

    def __init__(self, channel: int) -> None:
        self._out, self._sour = f"OUTP{channel}", f"SOUR{channel}"
        self.output = f"{self._out}?"

    def switch(self, *, on: bool) -> str:
        """Return what switches the output on or off."""
        return f"{self._out} {'ON' if on else 'OFF'}"

    def limits(self, load_ohm: float, limit_V: float) -> str:
        """Return what sets the termination and the voltage limits, with the function at 0 V."""
        return joined(
            f"{self.limit_switch} OFF",
            f"{self._out}:LOAD {'INF' if math.isinf(load_ohm) else f'{load_ohm:g}'}",
            f"{self._sour}:FUNC DC",
            f"{self._sour}:VOLT:OFFS 0",
            f"{self.limit}:HIGH {limit_V:.6g}",
            f"{self.limit}:LOW {-limit_V:.6g}",
            f"{self.limit_switch} ON",
        )

    def limited(self, load_ohm: float, limit_V: float) -> Wanted:
        """Return what has to be read after the limits were set."""
        return {
            f"{self._out}:LOAD?": load_ohm,
            f"{self.limit_switch}?": self.on,
            f"{self.limit}:HIGH?": limit_V,
            f"{self.limit}:LOW?": -limit_V,
            self.output: self.off,
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

    def held(self, load_ohm: float, voltage_V: float) -> Wanted:
        """Return what has to be read of a channel that holds a voltage."""
        return {
            f"{self._sour}:FUNC?": "DC",
            f"{self._sour}:VOLT:OFFS?": voltage_V,
            f"{self._out}:LOAD?": load_ohm,
            self.output: self.on,
        }

    def step(
        self, held_V: float, step_V: float, duration_s: float, delay_s: float, cycles: int
    ) -> list[str]:
        """Return what turns a steady channel, its output off, into one that waits for a trigger.

        Downwards the pulse is inverted about its offset. Several cycles are a square wave.
        """
        pulse = f"{self._sour}:FUNC:PULS"
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
                *(f"{pulse}:{first}" for first in self.before_width),
                f"{pulse}:WIDT MIN",
                f"{pulse}:PER {period_of(duration_s, cycles):.9g}",
                f"{pulse}:WIDT {duration_s:.9g}",
            ),
            joined(*self.triggered(delay_s, cycles)),
        ]

    def stepping(
        self,
        load_ohm: float,
        levels_V: tuple[float, float],
        duration_s: float,
        delay_s: float,
        cycles: int,
    ) -> Wanted:
        """Return what has to be read of a channel that waits at the first level for a trigger."""
        return {
            f"{self._sour}:FUNC?": "PULS",
            f"{self._sour}:VOLT:LOW?": min(levels_V),
            f"{self._sour}:VOLT:HIGH?": max(levels_V),
            f"{self._sour}:FUNC:PULS:WIDT?": duration_s,
            f"{self._out}:POL?": "NORM" if levels_V[1] > levels_V[0] else "INV",
            f"{self._out}:LOAD?": load_ohm,
            f"{self._sour}:BURS:STAT?": self.on,
            f"{self._sour}:BURS:NCYC?": float(cycles),
            **self.waits(delay_s),
            self.output: self.on,
        }

    @abstractmethod
    def triggered(self, delay_s: float, cycles: int) -> tuple[str, ...]:
        """Return what has a burst of so many pulses begin after each trigger."""

    @abstractmethod
    def waits(self, delay_s: float) -> Wanted:
        """Return what has to be read of that."""


def period_of(duration_s: float, cycles: int = 1) -> float:
    """Return the period of a pulse, in s; of several the pulse is half of it."""
    if cycles > 1:
        return 2.0 * duration_s
    return duration_s + max(PAUSE_SHARE * duration_s, PAUSE_S)


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
