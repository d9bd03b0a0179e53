"""The output stage of the supply: set points, their rounding, limits, compliance and protection.

The commands for limits and protections are from the manuals of the BOP 1KW family; whether the BIT
802E takes the same ones is not confirmed, so both spellings in the maker's manuals are taken:
POSitive and NEGative, HIGH and LOW.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np

from sim_instruments.kepco.current_loop import CurrentLoop, Pass
from sim_instruments.truth import Truth
from sim_instruments.wire.scpi import ScpiError, number_or
from sim_instruments.wire.scpi_device import Value
from sim_instruments.world.currents import CurrentHistory
from sim_instruments.world.piecewise import Array

Bounds = dict[tuple[str, str], float]
KINDS = {"CURR": "CURRent", "VOLT": "VOLTage"}
RATED = {"CURR": 12.0, "VOLT": 36.0}
CONVERTER_STEPS = 2**15
VOLTAGE_TRIPPED, CURRENT_TRIPPED = 4096, 8192


def scientific(value: float) -> str:
    """Return a number the way the card writes it, such as 1.39997E1."""
    mantissa, exponent = f"{value:.5E}".split("E")
    return f"{mantissa}E{int(exponent)}"


def extremes(low: float, high: float) -> dict[str, float]:
    """Return what MIN and MAX stand for."""
    return {"MAX": high, "MAXIMUM": high, "MIN": low, "MINIMUM": low}


class Output:
    """What the supply was commanded, and the level that it therefore drives into the coil.

    The output stage goes to the coil as a level in A: R times the level is the voltage at the
    terminals, so both the set point in voltage mode and the voltage compliance become levels.
    """

    rated: ClassVar[Mapping[str, float]] = RATED
    trips: ClassVar[tuple[str, ...]] = ("CURR", "VOLT")
    """Protections that switch the output off; the others hold it within themselves."""

    def __init__(self, coil: CurrentHistory, truth: Truth) -> None:
        self.coil = coil
        rated = self.rated
        self._gain = 1.0 + truth.quantity("gain_error", "1")
        self._offset_A = truth.quantity("offset", "A")
        # The converter's full scale is a little off the rating: set points fall on its steps.
        self._step = 1.0 + truth.quantity("converter_error", "1")
        sides = ("POS", "NEG")
        self.limits = {(kind, side): rated[kind] for kind in rated for side in sides}
        self.protections = {(kind, side): 1.01 * rated[kind] for kind in rated for side in sides}
        self._forget_settings()
        self.on = False
        self.tripped = 0
        self._sagging_V = np.inf
        self._overdrive = 1.0
        self._limits_act = not truth.switch("own_limit_broken")
        self.contact_sticks = truth.switch("output_stays_on")
        self._list: tuple[float, list[Pass]] | None = None
        loop = CurrentLoop(coil, lambda: self._compliance_A() if self.mode == "CURR" else None)
        self._stage = loop if truth.switch("current_loop") else coil

    def reset(self, time_s: float) -> None:
        """Go to voltage mode, zero, output off; limits stay as programmed."""
        self._forget_settings()
        self.switch(time_s, False)

    def _forget_settings(self) -> None:
        self.ranges = {"CURR": 1, "VOLT": 1}
        self.auto = {"CURR": True, "VOLT": True}
        self.levels = {"CURR": 0.0, "VOLT": 0.0}
        self.mode = "VOLT"

    def allowed(self, kind: str) -> tuple[float, float]:
        """Return the least and the greatest set point; the complementary one is a magnitude."""
        below, above = self._bounds(kind)
        return below if self.mode == kind else 0.0, above

    def check_level(self, kind: str, value: float) -> None:
        """Refuse what is out of range with -222."""
        below, above = self._bounds(kind)
        if not below <= value <= above:
            raise ScpiError(-222)

    def _bounds(self, kind: str) -> tuple[float, float]:
        full = self.rated[kind] / (1 if self.auto[kind] else self.ranges[kind])
        return -min(full, self._limit(kind, "NEG")), min(full, self._limit(kind, "POS"))

    def _limit(self, kind: str, side: str) -> float:
        """Return the limit that acts: one that is broken is shown, and holds nothing."""
        return self.limits[kind, side] if self._limits_act else np.inf

    def rounded(self, kind: str, value: float) -> float:
        """Return a set point as the converter and its calibration constants make it."""
        quarter = self.ranges[kind] == 4
        if self.auto[kind]:
            quarter = abs(value) <= self.rated[kind] / 4
        step = self.rated[kind] / CONVERTER_STEPS / (4 if quarter else 1) * self._step
        return round(value / step) * step

    def set_level(self, time_s: float, kind: str, value: float) -> None:
        """Take a new set point, refused with -222 when it is out of range."""
        low, high = self.allowed(kind)
        if not low <= value <= high:
            raise ScpiError(-222)
        self.levels[kind] = self.rounded(kind, value)
        self.hold(time_s)

    def pulse(self, time_s: float, kind: str, value: float, until_s: float) -> None:
        """Drive a transient value until `until_s`, then the set point again."""
        before = self.levels[kind]
        self.set_level(time_s, kind, value)
        during = self._driven_now()
        self.levels[kind] = before
        self._stage.pulse(time_s, during, until_s, self._driven_now())

    def set_mode(self, time_s: float, mode: str) -> None:
        """Change between controlling the voltage and the current."""
        if mode != self.mode:
            self.mode = mode
            for kind in self.levels:
                low, _ = self.allowed(kind)
                self.levels[kind] = max(self.levels[kind], low)
            self.hold(time_s)

    def switch(self, time_s: float, on: bool) -> None:
        """Switch the output; switching on clears a tripped protection."""
        self.on = on
        if on:
            self.tripped = 0
        self.hold(time_s)

    def set_range(self, time_s: float, kind: str, value: int, running: bool) -> None:
        """Fix the range; a set point beyond a quarter of the scale is a conflict with range 4."""
        if abs(self.levels[kind]) > self.rated[kind] / value:
            raise ScpiError(-221)
        self.ranges[kind], self.auto[kind] = value, False
        if not running:
            self.levels[kind] = self.rounded(kind, self.levels[kind])
            self.hold(time_s)

    def apply_limits(self, time_s: float, kind: str, running: bool) -> None:
        """Bring the set point within limits that were just changed."""
        low, high = self.allowed(kind)
        inside = min(max(self.levels[kind], low), high)
        if inside != self.levels[kind]:
            self.levels[kind] = self.rounded(kind, inside)
        if not running:
            self.hold(time_s)

    def hold(self, time_s: float) -> None:
        """Drive the fixed set point from now on."""
        self._list = None
        level = self._driven_now()
        self._stage.hold(time_s, level if self.on or self.contact_sticks else 0.0)

    def stay(self, time_s: float) -> None:
        """Hold the point where a list is, which becomes the set point."""
        left = self._left(time_s)
        if left:
            self.levels[self.mode] = float(left[0][0][0])
        self.hold(time_s)

    def halt(self, time_s: float) -> float:
        """Walk a list to the end of its cycle and hold its last point; return when that is, s."""
        left = self._left(time_s)
        if not left:
            return time_s
        levels, dwells, _ = left[0]
        self.levels[self.mode] = float(levels[-1])
        return self.run(time_s, [(levels, dwells, 1)])

    def run(self, time_s: float, passes: list[Pass]) -> float:
        """Drive lists of set points, then the fixed one; returns when the last one ends, in s."""
        self._list = time_s, passes
        driven = [
            (self._driven(levels) if self.on else np.zeros(levels.shape), dwells, cycles)
            for levels, dwells, cycles in passes
        ]
        then = self._driven_now() if self.on else 0.0
        if not self.on:
            then = 0.0
        return self._stage.run(time_s, driven, then)

    def sag(self, time_s: float, volts: float) -> None:
        """Give no more than `volts` from now on, whatever the voltage is set to; a list goes on."""
        self._sagging_V = volts
        self._drive_again(time_s)

    def overdrive(self, time_s: float, factor: float) -> None:
        """Drive so many times the current that is set from now on; a list goes on."""
        self._overdrive = factor
        self._drive_again(time_s)

    def _left(self, time_s: float) -> list[Pass]:
        return rest_of(self._list[1], time_s - self._list[0]) if self._list else []

    def _drive_again(self, time_s: float) -> None:
        left = self._left(time_s)
        if left:
            self.run(time_s, left)
        else:
            self.hold(time_s)

    def in_voltage_mode(self, time_s: float) -> bool:
        """Return whether the voltage, not the current, is what the supply holds now."""
        level = abs(float(self.coil.level(np.array([time_s]))[0]))
        if self.mode == "CURR":
            return level >= self._compliance_A() * (1.0 - 1e-9)
        return level < abs(self.levels["CURR"]) * (1.0 - 1e-9)

    def _compliance_A(self) -> float:
        return float(min(self.levels["VOLT"], self._sagging_V)) / self.coil.resistance_ohm

    def _driven_now(self) -> float:
        """Return the level in A that the set point makes."""
        return float(self._driven(np.array([self.levels[self.mode]]))[0])

    def _driven(self, levels: Array) -> Array:
        """Return the levels in A that set points make, after compliance and protection."""
        ohm = self.coil.resistance_ohm
        wanted_A = levels if self.mode == "CURR" else levels / ohm
        if self.mode == "CURR":
            wanted_A = (wanted_A * self._gain + self._offset_A) * self._overdrive
        bound = self._compliance_A()
        if self.mode != "CURR":
            bound = min(self.levels["CURR"], self._sagging_V / ohm)
        driven = np.clip(wanted_A, -bound, bound)
        if self.on:
            self._watch(driven)
        return np.zeros(levels.shape) if self.tripped else driven

    def _watch(self, driven_A: Array) -> None:
        highest, lowest = float(driven_A.max()), float(driven_A.min())
        ohm = self.coil.resistance_ohm
        for kind, scale, bit in (
            ("CURR", 1.0, CURRENT_TRIPPED),
            ("VOLT", ohm, VOLTAGE_TRIPPED),
        ):
            if kind in self.trips and (
                highest * scale > self.protections[kind, "POS"]
                or -lowest * scale > self.protections[kind, "NEG"]
            ):
                self.tripped |= bit
                self.on = False


def rest_of(passes: list[Pass], elapsed_s: float) -> list[Pass]:
    """Return what is left of lists of (levels, dwells, cycles) after some time; 0: endless."""
    for place, (levels, dwells, cycles) in enumerate(passes):
        ends = np.cumsum(dwells)
        period_s = float(ends[-1])
        if cycles and elapsed_s >= cycles * period_s:
            elapsed_s -= cycles * period_s
            continue
        done = int(elapsed_s // period_s)
        within_s = elapsed_s - done * period_s
        step = int(np.searchsorted(ends, within_s, side="right"))
        left: list[Pass] = []
        if step < levels.size:
            first_s = ends[step] - within_s
            left.append((levels[step:], np.concatenate(([first_s], dwells[step + 1 :])), 1))
        if not cycles or cycles > done + 1:
            left.append((levels, dwells, cycles and cycles - done - 1))
        return left + passes[place + 1 :]
    return []


SIDES: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("[:BOTH]",), ("POS", "NEG")),
    ((":POSitive", ":HIGH"), ("POS",)),
    ((":NEGative", ":LOW"), ("NEG",)),
)


def limit_commands(
    output: Output, changed: Callable[[str], None], *, limited: bool
) -> dict[str, Value]:
    """Return `CURR|VOLT:LIM`, where `limited`, and `CURR|VOLT:PROT` with their queries.

    A set point beyond a limit is refused; an output beyond a protection is switched off. What is
    `changed` of a kind is told.
    """

    def held(
        kind: str, table: Bounds, sides: tuple[str, ...], least: float, most: float
    ) -> tuple[Callable[[str], None], Callable[[], str]]:
        def take(text: str) -> None:
            # The negative side is given by its magnitude.
            value = abs(number_or(text, extremes(least, most)))
            if not least <= value <= most:
                raise ScpiError(-222)
            table.update(((kind, side), value) for side in sides)
            changed(kind)

        return take, lambda: ",".join(scientific(table[kind, side]) for side in sides)

    protections = output.protections
    bounds = [("PROTection", protections, 0.01, 1.01), ("PROTect", protections, 0.01, 1.01)]
    if limited:
        bounds.append(("LIMit", output.limits, 0.0, 1.0))
    return {
        f"{word}[:LEVel]:{what}{name}": held(kind, table, sides, least * rated, most * rated)
        for kind, word in KINDS.items()
        for rated in (output.rated[kind],)
        for what, table, least, most in bounds
        for names, sides in SIDES
        for name in names
    }
