"""Keysight 34465A multimeter (SCPI over TCP, lines end with LF): as a voltmeter, or with a Pt100.

Temperature from four-wire resistance by IEC 60751 (`generic/platinum.py`). Not confirmed in a
primary source: that four-wire resistance is always zeroed, as on the 34410A.

Other sources, and what else is not confirmed: see `multimeter_34465a_bursts.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from drivers.generic.burst_meter import Function, MainsSettings, is_overload
from drivers.generic.platinum import (
    HOTTEST_DEGC,
    R0,
    WIRES,
    impossible,
    resistance_ohm,
    temperature_degC,
)
from drivers.generic.voltmeter import Voltmeter
from drivers.keysight.multimeter_34465a_bursts import INTEGRATION_CYCLES, TruevoltMeter
from station.roles import Block, Place, quantity

VOLTS = Function("VOLT:DC", "V", (0.1, 1.0, 10.0, 100.0, 1000.0), (0.12, 1.2, 12.0, 120.0, 1000.0))


class Keysight34465A(Voltmeter, TruevoltMeter):
    """A voltmeter that takes bursts on one range, its input above 10 Gohm up to 10 V.

    Commands and their sources:
        VOLT:DC:RANG, VOLT:DC:NPLC, VOLT:DC:ZERO:AUTO - the measurement - Truevolt guide, public
            client code - confirmed
        VOLT:DC:IMP:AUTO - an input above 10 Gohm - Truevolt guide - confirmed
    """

    function = VOLTS
    highest_V: ClassVar = VOLTS.limits[-1]


OHMS = Function("FRES", "ohm", (100.0, 1e3, 1e4, 1e5, 1e6), (120.0, 1.2e3, 1.2e4, 1.2e5, 1.2e6))


def integrates_over(nplc: float) -> float:
    """Return an integration time that the meter has; raise ValueError for another."""
    if nplc not in INTEGRATION_CYCLES:
        known = ", ".join(f"{cycles:g}" for cycles in INTEGRATION_CYCLES)
        raise ValueError(f"it cannot integrate over nplc {nplc:g}; it can do {known}")
    return nplc


class Keysight34465APt100(TruevoltMeter):
    """A platinum thermometer at the device under test.

    Commands and their sources:
        FRES:RANG, FRES:NPLC - the measurement - Truevolt guide, public client code - confirmed
    """

    class Settings(MainsSettings):
        """The sensor, and how it is measured."""

        r0_ohm: R0 = 100.0
        nplc: Annotated[float, AfterValidator(integrates_over)] = Field(
            10.0, description="integration time in power-line cycles"
        )

    function = OHMS
    source = "thermometer"
    columns: ClassVar[Mapping[str, str]] = {
        "resistance_ohm": "ohm, four-wire resistance of the Pt100",
        "temperature_degC": "degC, by IEC 60751 from the resistance",
    }

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        settings = self.Settings.of(place)
        self._r0_ohm, self._nplc = settings.r0_ohm, settings.nplc
        # The highest temperature must fit; the test current is the same on 100 and 1000 ohm.
        hottest_ohm = resistance_ohm(HOTTEST_DEGC, self._r0_ohm)
        self._range_ohm = OHMS.range_for(hottest_ohm) or OHMS.ranges[-1]

    def start(self, readings: int) -> None:
        """Begin a burst of readings; returns at once."""
        self._prepare()
        self._begin(readings)

    def fetch(self) -> Block | None:
        """Return the burst that was started, None while it is being taken.

        Raises InstrumentError for a resistance that no Pt100 has: no such reading is a temperature.
        """
        ohms = self._values()
        if ohms is None:
            return None
        temperature_degC = self._temperature_degC(ohms)
        self.place.publish("temperature", float(temperature_degC[-1]), "degC")
        columns = {"resistance_ohm": ohms, "temperature_degC": temperature_degC}
        return Block(columns, np.full(len(ohms), self.place.clock.now()))

    @quantity("temperature", "degC")
    def _temperature_now_degC(self) -> float | None:
        self._prepare()
        ohms = self._value_now()
        return None if ohms is None else float(self._temperature_degC(np.array([ohms]))[0])

    def _prepare(self) -> None:
        self._choose(self._range_ohm, self._nplc, None, once=True)

    def _temperature_degC(self, ohms: NDArray[np.float64]) -> NDArray[np.float64]:
        overload = is_overload(ohms)
        if overload.any():
            raise self._overload(float(ohms[overload][0]), f"it is open: {WIRES}")
        wrong = impossible(ohms, self._r0_ohm)
        if wrong is not None:
            raise self.error("measured the Pt100", wrong, WIRES)
        return temperature_degC(ohms, self._r0_ohm)
