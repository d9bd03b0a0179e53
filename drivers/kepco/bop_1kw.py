"""Kepco BOP of the 1 kW family (MG, GL; MEL, MGL with LAN): the sine is the instrument's own.

From a third party's programming guide, not from the manual's own pages: `LIST:CURR:APPL
SINE,frequency,peak-to-peak[,offset]`, 0.01 Hz to 1.8 Hz in one segment, which takes all points of
the list; that `CURR:MODE FIX` leaves the output at the point where the list was, and not at the
fixed set-point as a BIT card does; `OUTP:CONT OFF` and `OUTP:MODE ACTIVE`; `SYST:REM ON` before
anything at the output; `VOLT:PROT` as the clamp in current mode, which cannot be set near zero.
From general knowledge: that `CURR:LIM?` and `VOLT:PROT?` tell what was set, within 1 %; the form
of its identity; that its frequency is as exact as its clock; that a sine begins at zero. Which of
the two `CURR:MODE FIX` does is no matter here: the list is left near a zero of its sine, and what
remains is ramped. Numbers have at most 4 digits before the point and 8 behind it (manual, p.B-2).

Commands and their sources:
    SYST:REM ON - takes the output over - BOP-GL guide - not confirmed
    OUTP:CONT OFF, OUTP:MODE ACTIVE - the output into a coil - BOP 1KW-MG manual, BOP-GL guide -
        confirmed
    VOLT:PROT, VOLT:PROT? - the clamp in current mode, both sides - BOP-GL guide - not confirmed
    CURR:LIM, CURR:LIM? - the current limit, both sides - BOP-GL guide - not confirmed
    LIST:CURR:APPL SINE - a sine of the instrument's own - BOP-GL guide - not confirmed
"""

from __future__ import annotations

from contextlib import suppress
from typing import ClassVar

from drivers.kepco.supply import BEHIND_MODEL, KepcoSupply
from drivers.transport.exchanges import Repeatable
from drivers.transport.text_line import ERROR_QUERY
from station.errors import InstrumentError

FREQUENCY_RANGE_HZ = (0.01, 1.8)
TOLERANCE = 0.01


class KepcoBop1kW(KepcoSupply):
    """A coil supply whose sine the instrument makes itself."""

    recognises: ClassVar[str] = (
        r"^KEPCO,\s*(?P<model>BOP\s?1KW\s+\d+-\d+\w*|BOP[^,]*?\d+-\d+\s*M?E?[GL]L?)" + BEHIND_MODEL
    )
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:ERR\?",
        r"(CURR|VOLT|OUTP|MEAS:CURR|MEAS:VOLT|STAT:OPER:COND|CURR:LIM|VOLT:PROT)\?( MAX)?",
        r"(CURR|VOLT:PROT|CURR:LIM) -?[\d.]+",
        r"FUNC:MODE CURR|CURR:MODE FIX|CURR:RANG 1|OUTP OFF|LIST:CLE",
        r"SYST:REM ON|OUTP:CONT OFF|OUTP:MODE ACTIVE",
    )
    """Not a segment, which is appended; nor the list's start, which begins a period again; nor
    the output's switching on, which lifts a protection that tripped meanwhile."""

    def _programme_limits(self) -> None:
        self._line.forget_errors()
        self._line.command("SYST:REM ON")
        self._line.command("OUTP:CONT OFF")
        self._line.command("OUTP:MODE ACTIVE")
        self._line.command("FUNC:MODE CURR")
        self._line.command("CURR:MODE FIX;:CURR 0")
        # First, since a lower limit that somebody left is what the supply then ends at.
        self._line.query(f"CURR:LIM {self._current_limit_A:.4f};{ERROR_QUERY}")
        self.check_rating("current", self._line.number("CURR? MAX"), "A")
        self._limit("VOLT:PROT", self._voltage_limit_V)
        self._limit("CURR:LIM", self._current_limit_A)

    def _take_over(self) -> None:
        with suppress(InstrumentError):  # one that takes no command may still be switched off
            self._line.query(f"SYST:REM ON;{ERROR_QUERY}")

    def last_attempt(self) -> None:
        """Take the output over and switch it off at once, and wait for no answer."""
        self._line.last_attempt("SYST:REM ON;:OUTP OFF")

    def _limit(self, header: str, value: float) -> None:
        """Set a limit on both sides and read it back."""
        self._line.command(f"{header} {value:.4f}")
        sides = self._line.numbers(f"{header}?")
        if not sides or any(abs(abs(side) - value) > TOLERANCE * value for side in sides):
            raise self.error(
                f"set {header} to {value:g}",
                f"it reads back {', '.join(f'{side:g}' for side in sides)}",
                "compare the bench file's limits with what the instrument can limit to",
            )

    def _prepare(self, frequency_Hz: float, amplitude_A: float) -> float:
        lowest_Hz, highest_Hz = FREQUENCY_RANGE_HZ
        if not lowest_Hz <= frequency_Hz <= highest_Hz:
            raise self.error(
                f"prepare a sine of {frequency_Hz:g} Hz",
                f"in one segment it makes {lowest_Hz:g} Hz to {highest_Hz:g} Hz",
                "change the plan's frequency",
            )
        self._line.command("CURR:MODE FIX;:CURR 0")
        self._line.command("CURR:RANG 1")
        self._line.command("LIST:CLE")
        given_Hz = float(f"{frequency_Hz:.7f}")
        self._line.command(f"LIST:CURR:APPL SINE,{given_Hz:.7f},{2.0 * amplitude_A:.4f},0")
        self._line.command("LIST:COUN 0")
        return given_Hz
