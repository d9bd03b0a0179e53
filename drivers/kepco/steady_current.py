"""A steady current from a Kepco BOP: ramped within the slew limit, settled by its read-back.

The status bit of voltage mode (8) is from public client code [C]; that the measured current agrees
with the set-point within 0.2 % and the bench's `zero_current` is an assumption about a supply in
calibration.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import pairwise

from drivers.transport.text_line import ERROR_QUERY, ScpiDriver
from station.errors import InstrumentError
from station.roles import CoilSettings, Place

STEP_S = 0.05
LOOK_S = 0.05
LOOKS = 4
FEWEST_LOOKS = 16
"""Where each look takes long, the patience is over before noise has had the chance to turn back."""
PATIENCE_S = 2.0
PATIENCE_TAUS = 20.0
RELATIVE_TOLERANCE = 0.002
MAX_READS = 4
VOLTAGE_MODE = 1 << 8
SETTLES_S = 0.5
MAX_CUT_A = 1.0
"""The energy of a coil of 18 mH is then 9 mJ, which any output stage takes."""


class SteadyCurrent(ScpiDriver, ABC):
    """What a supply that holds a current does.

    The coil's time constant is its inductance over its resistance; without these settings it is
    taken to be short against 0.1 s.
    """

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        coil = CoilSettings.of(place)
        self.coil_constant_mT_per_A = coil.coil_constant_mT_per_A
        self._current_limit_A = self.limit("current")
        self._ramp_step_A = self.limit("slew") * STEP_S
        self._zero_A = self.limit("zero_current")
        self._tau_s = 0.0
        if coil.coil_inductance_mH is not None and coil.coil_resistance_ohm is not None:
            self._tau_s = coil.coil_inductance_mH * 1e-3 / coil.coil_resistance_ohm

    @abstractmethod
    def current_A(self) -> float:
        """Return the measured output current in A."""

    def switch_on(self) -> None:
        """Switch the output on at a fixed current of zero; one that is on is ramped there."""
        if self._is_on():
            self.ramp_to(0.0)
            return
        self._line.command("CURR:MODE FIX;:CURR 0")
        # Automatic ranges would switch, with a jump, at a quarter of full scale.
        self._line.command("CURR:RANG 1")
        self._line.command("OUTP ON")
        if not self._is_on():
            raise self.error(
                "switched the output on",
                "it reads back as off",
                "look at the supply's display for a tripped protection and clear it",
            )

    def current_beyond_limit_A(self, limit_A: float, asked_A: float) -> float:
        """Return the current in A that flows where more is asked for than a limit of its own.

        A supply that refuses the set-point stays at zero; one that takes it holds the limit. The
        output is off before and after. Raises InstrumentError where it knows no limit of its own.
        """
        self.switch_on()
        try:
            self._line.command(f"CURR:LIM {limit_A:.4f}")
            self._line.query(f"CURR {asked_A:.4f};{ERROR_QUERY}")
            self.place.clock.sleep(SETTLES_S + PATIENCE_TAUS / 4.0 * self._tau_s)
            return self.current_A()
        finally:
            self.stop()
            self._line.command(f"CURR:LIM {self._current_limit_A:.4f}")

    def cut_off(self) -> None:
        """Switch the output off at once; refused beyond 1 A, where a coil needs a ramp."""
        if abs(self.current_A()) > MAX_CUT_A:
            raise self.error(
                "switch the output off at once",
                f"more than {MAX_CUT_A:g} A flow",
                "cut off a smaller current",
            )
        self._line.command("OUTP OFF")
        self.place.publish("output", "off")

    @abstractmethod
    def stop(self) -> None:
        """Bring the current to zero within the slew limit, output off."""

    def ramp_to(self, current_A: float) -> None:
        """Go to `current_A` in steps of the slew limit, and wait until the supply reads it back.

        Settled means that the last readings agree with the set-point and no longer move one way.
        Raises InstrumentError when the current is beyond the bench's limit, the output is off, or
        the current is not there 2 s and 20 time constants of the coil after the ramp.
        """
        attempted = f"ramp to {current_A:g} A"
        if not abs(current_A) <= self._current_limit_A:
            raise self.error(
                attempted,
                f"the bench allows {self._current_limit_A:g} A",
                "lower the plan's field, or raise limits.current where coil and supply stand it",
            )
        if not self._is_on():
            raise self.error(
                attempted, "the output is off", "switch it on first; see its display if it was on"
            )
        # The set-point is where a ramp starts: a supply in compliance reads less than commanded,
        # and what it drives follows its set-point no faster than that moves.
        begin_A = set_point_A(self._line.number)
        steps = math.ceil(abs(current_A - begin_A) / self._ramp_step_A - 1e-6)
        for step in range(1, steps + 1):
            level_A = begin_A + (current_A - begin_A) * step / steps
            self._line.command(f"CURR {level_A:.4f}")
            self.place.clock.sleep(STEP_S)
        self._settle(current_A, attempted)

    def _settle(self, current_A: float, attempted: str) -> None:
        clock = self.place.clock
        tolerance_A = self._zero_A + RELATIVE_TOLERANCE * abs(current_A)
        until_s = clock.now() + clock.patience_s(PATIENCE_S + PATIENCE_TAUS * self._tau_s)
        # Looked at once a time constant, what is still to come is as small as the last change.
        look_s = max(LOOK_S, self._tau_s)
        seen: list[float] = []
        looks = 0
        while True:
            looks += 1
            seen = [*seen[1 - LOOKS :], self.current_A()]
            near = [abs(seen_A - current_A) <= tolerance_A for seen_A in seen]
            agree = all(near)
            if len(seen) == LOOKS and agree and not moves_one_way(seen):
                return
            if clock.now() >= until_s and (looks >= FEWEST_LOOKS or not near[-1]):
                raise self._not_reached(attempted, seen[-1], near[-1])
            clock.sleep(look_s)

    def _not_reached(self, attempted: str, read_A: float, agree: bool) -> InstrumentError:
        read_A = round(read_A, 3) + 0.0  # no minus before a zero
        if not self._is_on():
            return self.error(
                attempted,
                f"the output went off, {read_A:.3f} A flow",
                "look at the supply's display for a tripped protection, and at the coil's cable",
            )
        if agree:
            return self.error(
                attempted,
                f"it still moves, at {read_A:.3f} A",
                "check settings.coil_inductance and coil_resistance, and the coil's cable",
            )
        if int(self._line.number("STAT:OPER:COND?")) & VOLTAGE_MODE:
            voltage_V = self._line.number("MEAS:VOLT?")
            return self.error(
                attempted,
                f"the supply is in compliance: {voltage_V:.2f} V at its terminals, and "
                f"{read_A:.3f} A flow",
                "check the coil's cable and contacts, let a hot coil cool, compare limits.voltage "
                "with what the coil needs",
            )
        return self.error(
            attempted,
            f"the set-point was never reached: {read_A:.3f} A flow",
            "check the supply's read-back against its display, and its calibration",
        )

    def _is_on(self) -> bool:
        is_on = self._line.number("OUTP?") != 0
        self.place.publish("output", "on" if is_on else "off")
        return is_on


def set_point_A(number: Callable[[str], float]) -> float:
    """Return the set-point that a supply reads back, in A; `number` asks it.

    A line that is one answer behind gives that of the question before: what counts is what comes
    twice.
    """
    read_A = number("CURR?")
    for _ in range(MAX_READS):
        before_A, read_A = read_A, number("CURR?")
        if read_A == before_A:
            break
    return read_A


def moves_one_way(readings: list[float]) -> bool:
    """Return whether each reading lies beyond the one before, all in one direction.

    Four readings of nothing but noise do so once in twelve times; an approach always does.
    """
    changes = [after - before for before, after in pairwise(readings)]
    return all(change > 0 for change in changes) or all(change < 0 for change in changes)
