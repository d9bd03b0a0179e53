"""What meters that take bursts share: a burst of readings is started, polled, fetched.

A maker's class sets its model up, begins a burst, looks how far it is, and reads it out; nothing
here waits for the end of a burst, which may be minutes away.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.transport.text_line import ScpiDriver, VisaSettings
from station.errors import InstrumentError
from station.fields import Unit
from station.roles import Place
from station.roles.patience import patience

MAX_READINGS = 10_000
"""In a burst."""
OVERLOAD, NO_READING = 9.9e37, 9.91e37
"""What meters with SCPI write for a reading beyond the range, and where there is none."""
BETWEEN_READINGS_S = 0.01
GRACE_S = 5.0
MAX_LOOK_S = 0.5


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
        return next((pair for pair, limit in pairs if abs(largest) <= limit), None)


class BurstMeter(ScpiDriver):
    """A meter set to one function; raises InstrumentError for whatever it answers wrongly."""

    Settings: ClassVar[type[MainsSettings]] = MainsSettings
    function: ClassVar[Function]
    integration_cycles: ClassVar[tuple[float, ...]]
    most_readings: ClassVar[int] = MAX_READINGS
    inputs: int = 1
    """How many it measures one after another for each reading."""
    when_odd = "check the cable and that nobody else talks to the instrument"

    @abstractmethod
    def _set_up(self, range_: float, nplc: float, auto_zero: bool | None) -> None:
        """Set range, integration time and auto-zero of the function, and read them back."""

    @abstractmethod
    def _initiate(self, readings: int) -> None:
        """Begin a burst whatever it does now, and forget older readings; returns at once."""

    @abstractmethod
    def _looked(self) -> tuple[bool, int]:
        """Return whether it measures, and how many readings it has."""

    @abstractmethod
    def _read_out(self, readings: int) -> NDArray[np.float64]:
        """Return the readings that it has, which stay in its memory.

        Shape (readings,), or (readings, inputs), where the first input is what is watched.
        """

    @abstractmethod
    def _last(self) -> float | None:
        """Return the last reading of the burst that runs, None where there is none yet."""

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._wanted_Hz = self.Settings.of(place).line_frequency_Hz
        self._range: float | None = None
        self._reading_s = 0.0
        self._pending = 0
        self._began_s = 0.0
        # Held while a burst is begun, and for the whole of a single reading of an interlock's.
        self._turn = place.clock.lock(f"{place.name} burst")

    def _choose(
        self, range_: float, nplc: float, auto_zero: bool | None, *, once: bool = False
    ) -> None:
        """Set range, integration time in power-line cycles and auto-zero, and read them back.

        `auto_zero` None: this function is always zeroed. `once`: not again where a range is chosen.
        """
        if nplc not in self.integration_cycles:
            raise self.error(
                f"integrate over {nplc:g} power-line cycles",
                f"it can do {', '.join(f'{cycles:g}' for cycles in self.integration_cycles)}",
                "write one of these; whole numbers of cycles reject the hum of the mains",
            )
        with self._turn:
            if once and self._range is not None:
                return
            self._range, self._pending = None, 0
            self._line.forget_errors()
            cycles_per_s = self._line_frequency_Hz()
            self._set_up(range_, nplc, auto_zero)
            self._reading_s = self.inputs * (1 if auto_zero is False else 2) * nplc / cycles_per_s
            self._range = range_

    def _begin(self, readings: int) -> None:
        """Begin a burst of readings, which forgets older ones; returns at once."""
        if not 1 <= readings <= MAX_READINGS:
            raise self.error(
                f"take a burst of {readings} readings",
                f"it can be asked for 1 to {MAX_READINGS}",
                "split the measurement into several bursts",
            )
        if self._range is None:
            raise self.error(
                "begin a burst", "no range was chosen yet", "configure it before its first burst"
            )
        with self._turn:
            self._go(readings)
            self._pending = readings

    def _values(self) -> NDArray[np.float64] | None:
        """Return the readings of the burst, as they are read out; None while it is being taken."""
        if not self._pending:
            raise self.error(
                "fetch a burst", "none was begun since the last one", "begin one before"
            )
        values = self._taken(self._pending)
        if values is not None:
            self._pending = 0
        return values

    @patience()
    def _value_now(self) -> float | None:
        """Return what is at the input now; None before a range was chosen, or a reading made.

        While a burst runs this is its last reading, so that the burst is not disturbed; otherwise
        a single reading is taken.
        """
        if self._range is None:
            return None
        with self._turn:
            if self._pending:
                return self._last()
            self._go(1)
            while True:
                look_s = min(self._reading_s + BETWEEN_READINGS_S, MAX_LOOK_S)
                self.place.clock.sleep(look_s)
                values = self._taken(1)
                if values is not None:
                    return float(values.flat[0])

    def _overload(self, reading: float, do_now: str | None = None) -> InstrumentError:
        """Return the error of an overloaded reading: the range, and the next higher one."""
        unit, present = self.function.unit, self._range or 0.0
        limit = dict(zip(self.function.ranges, self.function.limits, strict=True)).get(present)
        higher = next((larger for larger in self.function.ranges if larger > present), None)
        advice = "it is the highest: lower what is at its input"
        if higher is not None:
            advice = f"measure again on the next higher range, {higher:g} {unit}"
        return self.error(
            f"measured on its range of {present:g} {unit}",
            f"{reading:+.1E}, an overload: beyond {limit:g} {unit}",
            do_now or advice,
        )

    def _go(self, readings: int) -> None:
        self._initiate(readings)
        self._began_s = self.place.clock.now()

    def _taken(self, readings: int) -> NDArray[np.float64] | None:
        """Return the readings once the instrument has them all."""
        measures, points = self._looked()
        if measures:
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
        return self._read_out(readings)

    def _line_frequency_Hz(self) -> float:
        found_Hz = self._line.number("SYST:LFR?")
        wanted_Hz = found_Hz if self._wanted_Hz is None else self._wanted_Hz
        if found_Hz not in (50.0, 60.0) or wanted_Hz != found_Hz:
            raise self.error(
                "asked for the frequency of the mains",
                f"it measured {found_Hz:g} Hz, the bench file states {wanted_Hz:g} Hz",
                "correct settings.line_frequency, or switch the meter off and on at these mains",
            )
        return found_Hz

    def _readings(self, question: str, answer: str, readings: int) -> NDArray[np.float64]:
        """Return an answer as so many readings; anything else is InstrumentError."""
        values = self._numbers(question, answer)
        # 9.91E+37 says that there is no reading; an overload is one.
        if len(values) != readings or (np.abs(values) > OVERLOAD * 1.0005).any():
            raise self._line.odd(question, answer)
        return values

    def _numbers(self, question: str, answer: str) -> NDArray[np.float64]:
        try:
            values = np.array([float(text) for text in answer.split(",")])
        except ValueError:
            raise self._line.odd(question, answer) from None
        if not np.isfinite(values).all():
            raise self._line.odd(question, answer)
        return values


def is_overload(values: NDArray[np.float64] | float) -> NDArray[np.bool_]:
    """Return which readings are overloads."""
    return np.asarray(np.abs(values) >= OVERLOAD * 0.9995)
