"""Keithley DMM6500 multimeter (SCPI over TCP, lines end with LF), as a voltmeter.

The manual is DMM6500-901-01 Rev. A, as quoted with its pages in public notes on the command set; it
was not at hand itself. PyMeasure, QCoDeS and programs of laboratories are the clients. Not
confirmed: that ranges have an over-range, which is not used; how long a reading with auto-zero
takes; how long an answer of 1000 readings takes; that `*CLS` and a query share a message.

The meter has several command sets, and a change of the set needs a restart: where it is not SCPI,
nothing is set. Its readings stay in `defbuffer1`, from which they are read in pieces, and as often
as needed. There is no `*RST`: each setting that a reading hangs on is read, set, and put back.

Commands and their sources:
    *IDN? - who answers - PyMeasure, with the answer of a unit - confirmed
    *LANG? - the command set - manual p.2-29, QCoDeS - confirmed
    *CLS, SYST:ERR? - the error queue, empty as `0,"No error;0;0 0"` - manual p.13-164, PyMeasure -
        confirmed
    SYST:LFR? - the frequency of the mains - manual p.13-170, PyMeasure - confirmed
    SENS:FUNC - the function, answered with and without quotes - manual p.13-151, PyMeasure -
        confirmed
    VOLT:DC:RANG, VOLT:DC:RANG:AUTO - the range - manual p.13-112, 13-114, PyMeasure - confirmed
    VOLT:DC:NPLC - 0.0005 to 12 cycles, at 60 Hz to 15 - manual p.13-108 - confirmed
    VOLT:DC:AZER - auto-zero - manual p.13-98, PyMeasure - confirmed
    VOLT:DC:INP - AUTO is above 10 Gohm up to 10 V - manual p.13-106, public client code - confirmed
    VOLT:DC:AVER, VOLT:DC:REL:STAT, CALC:VOLT:DC:MATH:STAT - filter, null and scaling off -
        manual p.13-31, 13-97, 13-120, public client code - confirmed
    FORM:DATA - readings as text - manual p.13-44, public client code - confirmed
    TRIG:LOAD "SimpleLoop", INIT, ABOR - a burst - manual p.13-267, public client code - confirmed
    TRIG:STAT? - whether it measures, as `IDLE;IDLE;9` - manual p.13-271 - confirmed
    TRAC:CLE, TRAC:ACT?, TRAC:DATA? - the readings - manual p.13-175, 13-182, 13-183, public client
        code - confirmed
    9.9E+37 - an overload - manual p.13-114, PyMeasure; -9.9E+37 for a negative one - not confirmed
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.generic.burst_meter import Function
from drivers.generic.voltmeter import Voltmeter
from drivers.transport.exchanges import Repeatable

RANGES_V = (0.1, 1.0, 10.0, 100.0, 1000.0)
INTEGRATION_CYCLES = (0.0005, 0.001, 0.01, 0.1, 0.2, 1.0, 2.0, 5.0, 10.0, 12.0)
"""It takes any number from 0.0005 to 12; these are what a plan may ask for."""
BUFFER = '"defbuffer1"'
PIECE = 1000
RUNNING = ("RUNNING", "WAITING", "PAUSED", "BUILDING", "ABORTING")
STOPPED = ("IDLE", "ABORTED", "EMPTY", "FAILED")


class KeithleyDmm6500(Voltmeter):
    """A voltmeter that takes bursts on one range, its input above 10 Gohm up to 10 V."""

    recognises: ClassVar[str] = r"^KEITHLEY INSTRUMENTS,MODEL DMM6500,(?P<serial>[^,]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*(IDN|LANG)\?|\*CLS|[A-Z:]+\?|TRAC:ACT\? \"defbuffer1\"",
        r'TRAC:DATA\? \d+,\d+,"defbuffer1",READ',
        r'ABOR|TRAC:CLE "defbuffer1"|TRIG:LOAD "SimpleLoop",\d+,0,"defbuffer1"|INIT',
    )
    """A burst that is begun again consists of fresh readings: nothing is counted twice."""
    deadlines: ClassVar[Mapping[str, float]] = {r"TRAC:DATA\?": 2.0}
    """Not documented for 1000 readings: taken as 2 s."""
    function = Function("VOLT:DC", "V", RANGES_V, RANGES_V)
    integration_cycles: ClassVar[tuple[float, ...]] = INTEGRATION_CYCLES
    highest_V: ClassVar[float] = RANGES_V[-1]

    def configure(self, largest_V: float, nplc: float) -> float:
        """Choose range and integration time in power-line cycles; return the range in V.

        Raises InstrumentError where the meter is set to another command set than SCPI.
        """
        language = self._line.query("*LANG?").strip()
        if language != "SCPI":
            raise self.error(
                "asked for its command set",
                f"it is {language!r}, and nothing was set",
                "choose the command set SCPI in the meter's menu and restart the meter",
            )
        return super().configure(largest_V, nplc)

    def _set_up(self, range_: float, nplc: float, auto_zero: bool | None) -> None:
        # They are put back in the reverse order: a range that is set ends autoranging.
        for header, value in (
            ("SENS:FUNC", "VOLT:DC"),
            ("VOLT:DC:RANG:AUTO", "0"),
            ("VOLT:DC:RANG", f"{range_:g}"),
            ("VOLT:DC:NPLC", f"{nplc:g}"),
            ("VOLT:DC:AZER", "0" if auto_zero is False else "1"),
            ("VOLT:DC:INP", "AUTO"),
            ("VOLT:DC:AVER", "0"),
            ("VOLT:DC:REL:STAT", "0"),
            ("CALC:VOLT:DC:MATH:STAT", "0"),
            ("FORM:DATA", "ASC"),
        ):
            self.kept.set(header, value, partial(self._has, header), partial(self._write, header))

    def _has(self, header: str) -> str:
        return self._line.query(f"{header}?").strip().strip('"')

    def _write(self, header: str, value: str) -> None:
        # ABOR: what it refuses while it measures is not known.
        written = f'"{value}"' if header == "SENS:FUNC" else value
        self._line.command(f"ABOR;:{header} {written}")
        has = self._has(header)
        self.check_set(header, value, has, agrees=same(value, has))

    def _initiate(self, readings: int) -> None:
        loop = f'TRIG:LOAD "SimpleLoop",{readings},0,{BUFFER}'
        self._line.command(f"ABOR;:TRAC:CLE {BUFFER};:{loop};:INIT")

    def _looked(self) -> tuple[bool, int]:
        question = "TRIG:STAT?"
        answer = self._line.query(question)
        state = answer.partition(";")[0].strip().upper()
        if state not in RUNNING + STOPPED:
            raise self._line.odd(question, answer)
        return state in RUNNING, self._count()

    def _read_out(self, readings: int) -> NDArray[np.float64]:
        firsts = range(1, readings + 1, PIECE)
        pieces = [self._part(first, min(first + PIECE - 1, readings)) for first in firsts]
        return np.concatenate(pieces)

    def _last(self) -> float | None:
        count = self._count()
        return float(self._part(count, count)[0]) if count else None

    def _count(self) -> int:
        question = f"TRAC:ACT? {BUFFER}"
        answer = self._line.query(question)
        if not answer.strip().isdigit():
            raise self._line.odd(question, answer)
        return int(answer)

    def _part(self, first: int, last: int) -> NDArray[np.float64]:
        question = f"TRAC:DATA? {first},{last},{BUFFER},READ"
        return self._readings(question, self._line.query(question), last - first + 1)


def same(wanted: str, has: str) -> bool:
    """Whether a setting reads back as it was set: as the same word, or as the same number."""
    try:
        return abs(float(wanted) - float(has)) <= 1e-6 * abs(float(wanted))
    except ValueError:
        return wanted.upper() == has.upper()
