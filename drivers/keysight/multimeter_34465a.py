"""Keysight 34465A multimeter (SCPI over TCP, lines end with LF): bursts of DC voltage readings.

Sources and what is not confirmed: see `drivers/keysight/multimeter_34465a_bursts.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.keysight.multimeter_34465a_bursts import (
    INTEGRATION_CYCLES,
    MOST_READINGS,
    RECOGNISES,
    REPEATABLE,
    Bursts,
    Function,
    MainsSettings,
    is_overload,
)
from drivers.transport.retry import Repeatable
from station.errors import InstrumentError
from station.roles import Block, Driver, Identity, Place

VOLTS = Function("VOLT:DC", "V", (0.1, 1.0, 10.0, 100.0, 1000.0), (0.12, 1.2, 12.0, 120.0, 1000.0))


class Keysight34465A(Driver):
    """A voltmeter that takes bursts on one range, its input above 10 Gohm up to 10 V."""

    class Settings(MainsSettings):
        """How it measures."""

        auto_zero: bool = Field(True, description="without it twice as fast, and the zero drifts")

    recognises: ClassVar[str] = RECOGNISES
    roles: ClassVar = ("multimeter",)  # it has a thermometer's verbs, and measures volts
    repeatable: ClassVar[Repeatable] = REPEATABLE
    source = "multimeter"
    integration_cycles: ClassVar = INTEGRATION_CYCLES
    highest_V: ClassVar = VOLTS.limits[-1]
    most_readings: ClassVar = MOST_READINGS
    columns: ClassVar[Mapping[str, str]] = {
        "reading": "1, number of the reading in its burst, from 0",
        "voltage_V": "V at the input; ±9.9e37 beyond the range",
        "overload": "1 the input was beyond the range, 0 it was not",
    }

    def __init__(self, place: Place) -> None:
        self.place = place
        settings = self.Settings.of(place)
        self._auto_zero = settings.auto_zero
        self._bursts = Bursts(place, VOLTS, settings.line_frequency_Hz)

    def identify(self) -> Identity:
        """Ask `*IDN?`; the answer is maker, model, serial number, firmware."""
        return self._bursts.identify()

    def configure(self, largest_V: float, nplc: float) -> float:
        """Choose range and integration time in power-line cycles; return the range in V.

        It is the lowest range that holds `largest_V`, with its over-range of 20 %.
        """
        range_V = VOLTS.range_for(largest_V)
        if range_V is None:
            raise InstrumentError(
                self.place.name,
                f"choose a range for {largest_V:g} V",
                f"its highest one ends at {VOLTS.limits[-1]:g} V",
                "lower the largest voltage in the plan, or put a divider before its input",
            )
        self._bursts.choose(range_V, nplc, self._auto_zero)
        return range_V

    def start(self, readings: int) -> None:
        """Begin a burst of readings; returns at once."""
        self._bursts.begin(readings)

    def fetch(self) -> Block | None:
        """Return the burst that was started, None while it is being taken."""
        volts = self._bursts.values()
        if volts is None:
            return None
        overload = is_overload(volts)
        if not overload[-1]:
            self.place.publish("voltage", float(volts[-1]), "V")
        columns: dict[str, NDArray[Any]] = {
            "reading": np.arange(len(volts)),
            "voltage_V": volts,
            "overload": overload.astype(np.uint8),
        }
        return Block(columns, np.full(len(volts), self.place.clock.now()))

    def overload_error(self, reading_V: float) -> InstrumentError:
        """Return the error of an overloaded reading: the range, and the next higher one."""
        return self._bursts.overload(reading_V)

    def _voltage_V(self) -> float | None:
        """Return the voltage now, None before a range was chosen; an overload is an error."""
        volts = self._bursts.value_now()
        if volts is not None and is_overload(volts):
            raise self.overload_error(volts)
        if volts is not None:
            self.place.publish("voltage", volts, "V")
        return volts

    quantities: ClassVar = {"voltage": _voltage_V}

    def close(self) -> None:
        """Close the line."""
        self._bursts.close()
