"""What the two uses of a Keysight 34465A share: its set-up, its trigger and its memory.

Sources: Truevolt guide for the operation register (bits 4 and 5), for INITiate, which forgets older
readings, for `DATA:POINts?` and `DATA:LAST?`, which may be asked while it measures, and for the
auto-zero; public client code for the integration times, `+0,"No error"`, and ±9.9E+37 for an
overload. Not confirmed in a primary source: port 5025, that the 1000 V range has no over-range, and
how long `*RST` takes.
READ? is not used: its answer comes only when the burst is over, which may be minutes later.
Function, range and resolution are put back as they were met; `*RST` loses what else was set.

Commands and their sources:
    *IDN?, *CLS, *RST, SYST:ERR? - who answers, a known state, the error queue - Truevolt guide -
        confirmed
    CONF? - function, range and resolution as they were met - Truevolt guide - confirmed
    SYST:LFR? - the frequency of the mains - public client code - confirmed
    FUNC - what is measured - Truevolt guide, public client code - confirmed
    TRIG:SOUR, TRIG:COUN, TRIG:DEL:AUTO, SAMP:SOUR, SAMP:COUN - a burst - Truevolt guide - confirmed
    INIT, ABOR, STAT:OPER:COND?, DATA:POIN?, DATA:LAST?, FETC? - start, poll, fetch - Truevolt
        guide - confirmed
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.generic.burst_meter import NO_READING, BurstMeter
from drivers.transport.exchanges import Repeatable
from station.roles import Identity, Place

INTEGRATION_CYCLES = (0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1.0, 10.0, 100.0)
STILL_AT_IT = 16 | 32


class TruevoltMeter(BurstMeter):
    """A 34465A set to one function; raises InstrumentError for whatever it answers wrongly."""

    recognises: ClassVar[str] = (
        r"^(Keysight Technologies,34465A|Agilent Technologies,3441[01]A),(?P<serial>[^,]+)"
    )
    """`SYSTem:IDENtify` has it answer as its predecessors."""
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:(ERR|LFR)\?|STAT:OPER:COND\?|DATA:(POIN|LAST)\?|FETC\?",
        r"ABOR|SAMP:COUN \d+|INIT",
    )
    """A burst that is begun again consists of fresh readings: nothing is counted twice."""
    integration_cycles: ClassVar[tuple[float, ...]] = INTEGRATION_CYCLES
    deadlines: ClassVar[Mapping[str, float]] = {r"\*RST": 2.0}
    """Not documented: taken as 2 s."""

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._known = False
        """Whether nothing is left of what somebody set before: a null, a scaling, a smoothing."""

    def identify(self) -> Identity:
        """Ask `*IDN?`; what answers as a predecessor is noted."""
        identity = super().identify()
        if identity.model != "34465A":
            self.met(f"answers as {identity.maker} {identity.model} (SYST:IDEN)")
        return identity

    def _configured(self) -> str:
        """Return function, range and resolution, as `CONF:` takes them behind a colon."""
        return self._line.query("CONF?").strip().strip('"')

    def _configure_as(self, configured: str) -> None:
        self._line.command("ABOR")
        self._line.command(f"CONF:{configured}")

    def _set_up(self, range_: float, nplc: float, auto_zero: bool | None) -> None:
        header = self.function.header
        zero = "" if auto_zero is None else f"{header}:ZERO:AUTO {'ON' if auto_zero else 'OFF'}"
        if not self._known:
            self.kept.meet("CONF", header, self._configured, self._configure_as)
        for message in (
            "ABOR" if self._known else "*RST",
            f'FUNC "{header}"',
            f"{header}:RANG {range_:g}",
            f"{header}:NPLC {nplc:g}",
            *([zero] if zero else []),
            *(["VOLT:DC:IMP:AUTO ON"] if header == "VOLT:DC" else []),
            "TRIG:SOUR IMM",
            "TRIG:COUN 1",
            "TRIG:DEL:AUTO ON",
            "SAMP:SOUR IMM",
        ):
            self._line.command(message)
        for setting, wanted in (("RANG", range_), ("NPLC", nplc)):
            has = self._line.number(f"{header}:{setting}?")
            agrees = abs(has - wanted) <= 1e-6 * wanted
            self.check_set(f"{header}:{setting}", f"{wanted:g}", f"{has:g}", agrees=agrees)
        self._known = True

    def _initiate(self, readings: int) -> None:
        # ABOR: where the answer to an INIT was lost, it measures already and would refuse another.
        self._line.command(f"ABOR;:SAMP:COUN {readings};:INIT")

    def _looked(self) -> tuple[bool, int]:
        condition, points = self._line.answers({"STAT:OPER:COND?": int, "DATA:POIN?": int})
        return bool(condition & STILL_AT_IT), points

    def _read_out(self, readings: int) -> NDArray[np.float64]:
        return self._readings("FETC?", self._line.query("FETC?"), readings)

    def _last(self) -> float | None:
        answer = self._line.query("DATA:LAST?")
        value = float(self._numbers("DATA:LAST?", answer.split(" ")[0])[0])
        return None if abs(value) >= NO_READING * 0.9999 else value
