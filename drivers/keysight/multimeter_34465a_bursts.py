"""What the two uses of a Keysight 34465A share: a burst of readings is started, polled, fetched.

Sources: Truevolt guide for the operation register (bits 4 and 5), for INITiate, which forgets older
readings, for `DATA:POINts?` and `DATA:LAST?`, which may be asked while it measures, and for the
auto-zero; public client code for the integration times, `+0,"No error"`, and ±9.9E+37 for an
overload. Not confirmed in a primary source: port 5025, that the 1000 V range has no over-range, and
that `*RST` is done within 0.5 s.
READ? is not used: its answer comes only when the burst is over, which may be minutes later.
Function, range and resolution are put back as they were met; `*RST` loses what else was set.

Commands and their sources:
    *IDN?, *CLS, *RST, SYST:ERR? - who answers, a known state, the error queue - Truevolt guide -
        confirmed
    CONF? - function, range and resolution as they were met - Truevolt guide - confirmed
    SYST:LFR? - the frequency of the mains - public client code - confirmed
    FUNC, RANG, NPLC, ZERO:AUTO - the measurement - Truevolt guide, public client code - confirmed
    VOLT:DC:IMP:AUTO - an input above 10 Gohm - Truevolt guide - confirmed
    TRIG:SOUR, TRIG:COUN, TRIG:DEL:AUTO, SAMP:SOUR, SAMP:COUN - a burst - Truevolt guide - confirmed
    INIT, ABOR, STAT:OPER:COND?, DATA:POIN?, DATA:LAST?, FETC? - start, poll, fetch - Truevolt
        guide - confirmed
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.transport.line import odd
from drivers.transport.retry import Repeatable
from drivers.transport.visa_line import ERROR_QUERY, PatientLine, ScpiDriver, ScpiLine, VisaSettings
from station.errors import InstrumentError
from station.fields import Unit
from station.roles import Identity, Place

INTEGRATION_CYCLES = (0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1.0, 10.0, 100.0)
MOST_READINGS = 10_000
"""In a burst: what can be fetched in one answer of less than 0.5 s, whatever options it has."""
STILL_AT_IT = 16 | 32
OVERLOAD, NO_READING = 9.9e37, 9.91e37
BETWEEN_READINGS_S = 0.01
GRACE_S = 5.0
LONGEST_LOOK_S = 0.5


class MainsSettings(VisaSettings):
    """What the bench file says of a meter whose readings last whole cycles of the mains."""

    line_frequency_Hz: Annotated[float | None, Unit("Hz")] = Field(
        None, ge=50, le=60, multiple_of=10, description="compared with what the meter found"
    )


@dataclass(frozen=True)
class Function:
    """A measurement function: its header, its unit, its ranges and how far each one holds."""

    header: str
    unit: str
    ranges: tuple[float, ...]
    limits: tuple[float, ...]

    def range_for(self, largest: float) -> float | None:
        """Return the lowest range that holds a magnitude, None where none does."""
        pairs = zip(self.ranges, self.limits, strict=True)
        return next((one for one, limit in pairs if abs(largest) <= limit), None)


class BurstMeter(ScpiDriver):
    """A 34465A set to one function; raises InstrumentError for whatever it answers wrongly."""

    Settings: ClassVar[type[MainsSettings]] = MainsSettings
    recognises: ClassVar[str] = (
        r"^(Keysight Technologies,34465A|Agilent Technologies,3441[01]A),(?P<serial>[^,]+)"
    )
    """`SYSTem:IDENtify` has it answer as its predecessors."""
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:(ERR|LFR)\?|STAT:OPER:COND\?|DATA:(POIN|LAST)\?|FETC\?",
        r"ABOR|SAMP:COUN \d+|INIT",
    )
    """A burst that is begun again consists of fresh readings: nothing is counted twice."""
    function: ClassVar[Function]

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._wanted_Hz = self.Settings.of(place).line_frequency_Hz
        self._range: float | None = None
        self._reading_s = 0.0
        self._known = False
        """Whether nothing is left of what somebody set before: a null, a scaling, a smoothing."""
        self._pending = 0
        self._began_s = 0.0
        # Held while a burst is begun, and for the whole of a single reading of an interlock's.
        self._turn = place.clock.lock(f"{place.name} burst")

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

    def _choose(
        self, range_: float, nplc: float, auto_zero: bool | None, *, once: bool = False
    ) -> None:
        """Set range, integration time in power-line cycles and auto-zero, and read them back.

        `auto_zero` None: this function is always zeroed. `once`: not again where a range is chosen.
        """
        if nplc not in INTEGRATION_CYCLES:
            raise self.error(
                f"integrate over {nplc:g} power-line cycles",
                f"it can do {', '.join(f'{one:g}' for one in INTEGRATION_CYCLES)}",
                "write one of these; 1, 10 and 100 reject the hum of the mains",
            )
        header = self.function.header
        zero = "" if auto_zero is None else f"{header}:ZERO:AUTO {'ON' if auto_zero else 'OFF'}"
        with self._turn:
            if once and self._range is not None:
                return
            self._range, self._pending = None, 0
            # What was refused before must not be taken for a refusal of what follows.
            self._line.query(f"*CLS;{ERROR_QUERY}")
            cycles_per_s = self._line_frequency_Hz()
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
                if abs(has - wanted) > 1e-6 * wanted:
                    raise self.error(
                        f"set {header}:{setting} to {wanted:g}",
                        f"it reads back {has:g}",
                        "check that nobody works at its front panel, then run again",
                    )
            self._known = True
            self._reading_s = (1 if auto_zero is False else 2) * nplc / cycles_per_s
            self._range = range_

    def _begin(self, readings: int) -> None:
        """Begin a burst of readings, which forgets older ones; returns at once."""
        if not 1 <= readings <= MOST_READINGS:
            raise self.error(
                f"take a burst of {readings} readings",
                f"it can be asked for 1 to {MOST_READINGS}",
                "split the measurement into several bursts",
            )
        if self._range is None:
            raise self.error(
                "begin a burst", "no range was chosen yet", "configure it before its first burst"
            )
        with self._turn:
            self._initiate(self._line, readings)
            self._pending = readings

    def _values(self) -> NDArray[np.float64] | None:
        """Return the readings of the burst, shape (readings,), None while it is being taken."""
        if not self._pending:
            raise self.error(
                "fetch a burst", "none was begun since the last one", "begin one before"
            )
        values = self._taken(self._line, self._pending)
        if values is not None:
            self._pending = 0
        return values

    def _value_now(self) -> float | None:
        """Return what is at the input now; None before a range was chosen, or a reading made.

        While a burst runs this is its last reading, so that the burst is not disturbed; otherwise
        a single reading is taken.
        """
        if self._range is None:
            return None
        with self._turn:
            if self._pending:
                answer = self._line.patient.query("DATA:LAST?")
                value = self._numbers("DATA:LAST?", answer.split(" ")[0])[0]
                return None if abs(value) >= NO_READING * 0.9999 else float(value)
            self._initiate(self._line.patient, 1)
            while True:
                look_s = min(self._reading_s + BETWEEN_READINGS_S, LONGEST_LOOK_S)
                self.place.clock.sleep(look_s)
                values = self._taken(self._line.patient, 1)
                if values is not None:
                    return float(values[0])

    def _overload(self, reading: float, do_now: str | None = None) -> InstrumentError:
        """Return the error of an overloaded reading: the range, and the next higher one."""
        unit, present = self.function.unit, self._range or 0.0
        limit = dict(zip(self.function.ranges, self.function.limits, strict=True)).get(present)
        higher = next((one for one in self.function.ranges if one > present), None)
        advice = "it is the highest: lower what is at its input"
        if higher is not None:
            advice = f"measure again on the next higher range, {higher:g} {unit}"
        return self.error(
            f"measured on its range of {present:g} {unit}",
            f"{reading:+.1E}, an overload: beyond {limit:g} {unit}",
            do_now or advice,
        )

    def _initiate(self, line: ScpiLine | PatientLine, readings: int) -> None:
        # ABOR: where the answer to an INIT was lost, it measures already and would refuse another.
        line.command(f"ABOR;:SAMP:COUN {readings};:INIT")
        self._began_s = self.place.clock.now()

    def _taken(self, line: ScpiLine | PatientLine, readings: int) -> NDArray[np.float64] | None:
        """Return the readings once the instrument has them all."""
        question = "STAT:OPER:COND?;:DATA:POIN?"
        answer = line.query(question)
        try:
            condition, points = (int(part) for part in answer.split(";"))
        except ValueError:
            raise self._odd(question, answer) from None
        if condition & STILL_AT_IT:
            expected_s = readings * (self._reading_s + BETWEEN_READINGS_S)
            took_s = self.place.clock.now() - self._began_s
            if took_s > self.place.clock.patience_s(2 * expected_s + GRACE_S):
                raise self.error(
                    f"waited for {readings} readings",
                    f"after {took_s:.3g} s it has {points} and is not ready, where "
                    f"{expected_s:.3g} s were expected",
                    "look at its display, and that its trigger is not set to external",
                )
            return None
        if points != readings:
            raise self.error(
                f"took a burst of {readings} readings",
                f"it ended with {points} in its memory",
                "check that nobody else uses the instrument, then measure again",
            )
        answer = line.query("FETC?")
        values = self._numbers("FETC?", answer)
        # 9.91E+37 says that there is no reading; an overload is one.
        if len(values) != readings or (np.abs(values) > OVERLOAD * 1.0005).any():
            raise self._odd("FETC?", answer)
        return values

    def _line_frequency_Hz(self) -> float:
        found_Hz = self._line.number("SYST:LFR?")
        wanted_Hz = found_Hz if self._wanted_Hz is None else self._wanted_Hz
        if found_Hz not in (50.0, 60.0) or wanted_Hz != found_Hz:
            raise self.error(
                "asked for the frequency of the mains",
                f"it found {found_Hz:g} Hz, the bench file says {wanted_Hz:g} Hz",
                "correct settings.line_frequency, or switch the meter off and on at these mains",
            )
        return found_Hz

    def _numbers(self, question: str, answer: str) -> NDArray[np.float64]:
        try:
            values = np.array([float(text) for text in answer.split(",")])
        except ValueError:
            raise self._odd(question, answer) from None
        if not np.isfinite(values).all():
            raise self._odd(question, answer)
        return values

    def _odd(self, question: str, answer: str) -> InstrumentError:
        return odd(
            self.place.name,
            f"asked {question}",
            answer,
            "check the cable and that nobody else talks to the instrument",
        )


def is_overload(values: NDArray[np.float64] | float) -> NDArray[np.bool_]:
    """Return which readings are overloads."""
    return np.asarray(np.abs(values) >= OVERLOAD * 0.9995)
