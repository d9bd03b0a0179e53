"""What a Keysight 34465A measures and when: FUNC, CONF, [SENS:]…, TRIG and SAMP.

From the Truevolt guide and public client code: names of functions in quotes, the next range up for
a number, integration times from a list, settings that change forget older readings. `INITiate`
leaves idle and forgets older readings, each trigger starts `SAMPle:COUNt` readings, after
`TRIGger:COUNt` triggers it is idle again, the trigger delay comes before every reading, or before
the first one only where a sample timer paces them. Assumed: a four-wire resistance has no
ZERO:AUTO, an integration time that is not in the list is refused; the automatic delay, and what
the instrument needs between two readings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from sim_instruments.keysight.multimeter_34465a_converter import (
    APERTURES_S,
    CYCLES,
    RESOLUTION,
    Converter,
    Function,
    functions,
)
from sim_instruments.wire.scpi import CommandTree, ScpiError, boolean, choice, numeric, one
from sim_instruments.wire.scpi import whole_number as whole
from sim_instruments.world.piecewise import Array

HEADERS = {
    "VOLT": "VOLTage[:DC]",
    "VOLT:AC": "VOLTage:AC",
    "CURR": "CURRent[:DC]",
    "CURR:AC": "CURRent:AC",
    "RES": "RESistance",
    "FRES": "FRESistance",
}
NAMES = {
    "VOLTAGE": "VOLT",
    "CURRENT": "CURR",
    "RESISTANCE": "RES",
    "FRESISTANCE": "FRES",
}


def unquoted(text: str) -> str:
    """Return what stands between quotes; ScpiError -151 without them."""
    if len(text) < 2 or text[0] not in "\"'" or text[-1] != text[0]:
        raise ScpiError(-151)
    return text[1:-1]


class Sense:
    """The functions with their settings, the chosen one, and the commands that change them.

    `changed` is called after each change, `now_s` tells the time of a new zero.
    """

    def __init__(
        self, converter: Converter, changed: Callable[[], None], now_s: Callable[[], float]
    ) -> None:
        self._converter, self._changed, self._now_s = converter, changed, now_s
        self.functions = functions()
        self.chosen = self.functions["VOLT"]

    def reset(self) -> None:
        """Go to DC volts, everything automatic, ten power-line cycles."""
        for name, fresh in functions().items():
            vars(self.functions[name]).update(vars(fresh))
        self.chosen = self.functions["VOLT"]

    def add_to(self, tree: CommandTree) -> None:
        """Add the commands to a device's."""
        for root in ("", "SENSe:"):
            tree.add(f"{root}FUNCtion[:ON]", self._choose)
            tree.add(f"{root}FUNCtion[:ON]?", lambda _: f'"{self.chosen.name}"')
            for name, header in HEADERS.items():
                self._add_function(tree, root + header, self.functions[name])
        tree.add("CONFigure?", lambda _: self._configured())

    def configure(self, function: Function, parameters: list[str]) -> None:
        """Choose a function with its range and resolution, everything else as after `*RST`."""
        if len(parameters) > 2:
            raise ScpiError(-108)
        vars(function).update(vars(functions()[function.name]))
        if parameters and parameters[0].upper() not in ("AUTO", "DEF"):
            self._set_range(function, parameters[0])
        if len(parameters) == 2 and parameters[1].upper() != "DEF":
            self._set_resolution(function, parameters[1])
        self._take(function)

    def _add_function(self, tree: CommandTree, header: str, function: Function) -> None:
        converter = self._converter

        def setter(act: Callable[[Function, str], None]) -> Callable[[list[str]], None]:
            def handler(parameters: list[str]) -> None:
                act(function, one(parameters))
                function.zeroed_at_s = self._now_s()
                self._changed()

            return handler

        def limits(parameters: list[str], present: float, low: float, high: float) -> str:
            return f"{numeric(parameters[0], low, high, low) if parameters else present:+.8E}"

        lowest, highest = function.ranges[0], function.ranges[-1]
        tree.add(f"{header}:RANGe[:UPPer]", setter(self._set_range))
        tree.add(f"{header}:RANGe[:UPPer]?", lambda p: limits(p, function.range, lowest, highest))
        tree.add(f"{header}:RANGe:AUTO", setter(self._set_autorange))
        tree.add(f"{header}:RANGe:AUTO?", lambda _: str(int(function.autorange)))
        if header.endswith(":AC"):
            return
        tree.add(f"{header}:NPLCycles", setter(self._set_cycles))
        tree.add(
            f"{header}:NPLCycles?", lambda p: limits(p, function.cycles, CYCLES[0], CYCLES[-1])
        )
        tree.add(f"{header}:APERture", setter(self._set_aperture))
        tree.add(
            f"{header}:APERture?",
            lambda p: limits(p, converter.aperture_s(function), *APERTURES_S),
        )
        tree.add(f"{header}:APERture:ENABled", setter(self._enable_aperture))
        tree.add(f"{header}:APERture:ENABled?", lambda _: str(int(bool(function.aperture_s))))
        tree.add(f"{header}:RESolution", setter(self._set_resolution))
        tree.add(
            f"{header}:RESolution?",
            lambda _: f"{converter.resolution(function) * function.range:+.8E}",
        )
        if function.can_zero:
            tree.add(f"{header}:ZERO:AUTO", setter(self._set_zero))
            tree.add(f"{header}:ZERO:AUTO?", lambda _: str(int(function.zero_on)))
        if function.name == "VOLT":
            # Neither impedance loads what the simulated worlds have to measure.
            self._high_impedance = False
            tree.add(f"{header}:IMPedance:AUTO", setter(self._set_impedance))
            tree.add(f"{header}:IMPedance:AUTO?", lambda _: str(int(self._high_impedance)))

    def _choose(self, parameters: list[str]) -> None:
        name = unquoted(one(parameters)).upper().removesuffix(":DC")
        head, colon, rest = name.partition(":")
        name = NAMES.get(head, head) + colon + rest
        if name not in self.functions:
            raise ScpiError(-224)
        self._take(self.functions[name])

    def _take(self, function: Function) -> None:
        self.chosen = function
        function.zeroed_at_s = self._now_s()
        self._changed()

    def _configured(self) -> str:
        used = self.chosen
        resolution = self._converter.resolution(used) * used.range
        return f'"{used.name} {used.range:+.8E},{resolution:+.8E}"'

    def _set_range(self, function: Function, text: str) -> None:
        wanted = abs(numeric(text, -function.ranges[-1], function.ranges[-1], function.ranges[0]))
        function.range = next(one for one in function.ranges if wanted <= one * (1 + 1e-9))
        function.autorange = False

    def _set_autorange(self, function: Function, text: str) -> None:
        function.autorange = text.upper() != "ONCE" and boolean(text)
        if text.upper() == "ONCE":
            function.range = self._converter.range_now(function, self._now_s())

    def _set_cycles(self, function: Function, text: str) -> None:
        wanted = numeric(text, CYCLES[0], CYCLES[-1], 10.0)
        if wanted not in CYCLES:
            raise ScpiError(-224)
        function.cycles, function.aperture_s = wanted, None

    def _set_aperture(self, function: Function, text: str) -> None:
        function.aperture_s = numeric(text, *APERTURES_S, 0.1)

    def _enable_aperture(self, function: Function, text: str) -> None:
        function.aperture_s = self._converter.aperture_s(function) if boolean(text) else None

    def _set_resolution(self, function: Function, text: str) -> None:
        best = {
            c: relative * function.range for c, relative in zip(CYCLES, RESOLUTION, strict=True)
        }
        wanted = numeric(text, min(best.values()), max(best.values()), best[10.0])
        function.cycles = next(c for c in CYCLES if best[c] <= wanted * (1 + 1e-6))
        function.aperture_s = None

    def _set_zero(self, function: Function, text: str) -> None:
        function.zero_on = text.upper() != "ONCE" and boolean(text)

    def _set_impedance(self, function: Function, text: str) -> None:
        self._high_impedance = boolean(text)


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
        self.timed, self.timer_s, self.before = False, 1.0, 0
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
            return np.empty(0, dtype=np.float64), 0
        self._taken += new
        first = self._taken - min(new, room)
        numbers = np.arange(first, self._taken, dtype=np.float64)
        return self._begin_s + self._period_s * numbers, new

    def _start(self, now_s: float, readings: int) -> None:
        self._begin_s = now_s + self.pause_s()
        period_s = self.least_period_s(self._busy_s)
        self._period_s = max(period_s, self.timer_s) if self.timed else period_s
        self._planned, self._taken = readings, 0


SOURCES = {"IMM": "IMM", "IMMEDIATE": "IMM", "BUS": "BUS", "EXT": "EXT", "EXTERNAL": "EXT"}
SOURCES |= {"INT": "INT", "INTERNAL": "INT"}
SLOPES = {"POS": "POS", "POSITIVE": "POS", "NEG": "NEG", "NEGATIVE": "NEG"}
PACES = {"IMM": "", "IMMEDIATE": "", "TIM": "TIM", "TIMER": "TIM"}


def add_trigger_commands(
    tree: CommandTree,
    trigger: TriggerSystem,
    changed: Callable[[], None],
    least_period_s: Callable[[], float],
) -> None:
    """Add the commands TRIGger and SAMPle to a device's; `changed` is called after each change."""

    def add(header: str, name: str, read: Callable[[str], Any], give: Callable[[], str]) -> None:
        def handler(parameters: list[str]) -> None:
            setattr(trigger, name, read(one(parameters)))
            changed()

        tree.add(header, handler)
        tree.add(f"{header}?", lambda _: give())

    def count(text: str) -> int:
        return round(numeric(text, 1, MOST_SAMPLES, 1))

    def many(text: str) -> float:
        return math.inf if text.upper() in ("INF", "INFINITY") else count(text)

    def delay(text: str) -> float | None:
        return None if boolean(text) else trigger.pause_s()

    def interval(text: str) -> float:
        return numeric(text, min(least_period_s(), 3600.0), 3600.0, 1.0)

    add("TRIGger:SOURce", "source", lambda t: choice(t, SOURCES), lambda: trigger.source)
    add("TRIGger:SLOPe", "slope", lambda t: choice(t, SLOPES), lambda: trigger.slope)
    add("TRIGger:LEVel", "level_V", level, lambda: f"{trigger.level_V:+.8E}")
    add("TRIGger:COUNt", "triggers", many, lambda: f"{min(trigger.triggers, 9.9e37):+.8E}")
    add("TRIGger:DELay", "delay_s", pause, lambda: f"{trigger.pause_s():+.8E}")
    add("TRIGger:DELay:AUTO", "delay_s", delay, lambda: str(int(trigger.delay_s is None)))
    add("SAMPle:COUNt", "samples", count, lambda: f"{trigger.samples:+d}")
    add("SAMPle:COUNt:PRETrigger", "before", lambda t: whole(t, 0, 0), lambda: "+0")
    add("SAMPle:SOURce", "timed", paced, lambda: "TIM" if trigger.timed else "IMM")
    add("SAMPle:TIMer", "timer_s", interval, lambda: f"{trigger.timer_s:+.8E}")
    tree.add("SAMPle:TIMer?", lambda p: f"{interval(p[0]) if p else trigger.timer_s:+.8E}")


def level(text: str) -> float:
    """Return the level of an internal trigger in V."""
    return numeric(text, -1000.0, 1000.0, 0.0)


def pause(text: str) -> float:
    """Return a trigger delay in s."""
    return numeric(text, 0.0, 3600.0, 1.0)


def paced(text: str) -> bool:
    """Return whether a sample timer paces the readings."""
    return choice(text, PACES) == "TIM"
