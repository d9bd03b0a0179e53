"""What voltmeters in the role `multimeter` share: a range, a burst of volts, overloads marked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.generic.burst_meter import BurstMeter, MainsSettings, is_overload
from station.errors import InstrumentError
from station.roles import Block, Place, quantity


class Voltmeter(BurstMeter):
    """A voltmeter that takes bursts on one range."""

    class Settings(MainsSettings):
        """How it measures."""

        auto_zero: bool = Field(True, description="without it twice as fast, and the zero drifts")

    roles: ClassVar = ("multimeter",)  # it has a thermometer's verbs, and measures volts
    source = "multimeter"
    highest_V: ClassVar[float]
    columns: ClassVar[Mapping[str, str]] = {
        "reading": "1, number of the reading in its burst, from 0",
        "voltage_V": "V at the input; ±9.9e37 beyond the range",
        "overload": "1 the input was beyond the range, 0 it was not",
    }

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._auto_zero = self.Settings.of(place).auto_zero

    def configure(self, largest_V: float, nplc: float) -> float:
        """Choose range and integration time in power-line cycles; return the range in V.

        It is the lowest range that holds `largest_V`, with its over-range where that is known.
        """
        range_V = self.function.range_for(largest_V)
        if range_V is None:
            raise self.error(
                f"choose a range for {largest_V:g} V",
                f"its highest one ends at {self.highest_V:g} V",
                "lower the largest voltage in the plan, or put a divider before its input",
            )
        self._choose(range_V, nplc, self._auto_zero)
        return range_V

    def start(self, readings: int) -> None:
        """Begin a burst of readings; returns at once."""
        self._begin(readings)

    def fetch(self) -> Block | None:
        """Return the burst that was started, None while it is being taken."""
        volts = self._values()
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
        return self._overload(reading_V)

    @quantity("voltage", "V")
    def _voltage_V(self) -> float | None:
        """Return the voltage now, None before a range was chosen; an overload is an error."""
        volts = self._value_now()
        if volts is not None and is_overload(volts):
            raise self.overload_error(volts)
        return volts
