"""A simulated 34465A in a small world of the tests' own, and who talks to it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock
from typing import Any

import numpy as np
from sim_bench import Line

from sim_instruments.faults.instrument import InstrumentFaults, Schedule
from sim_instruments.faults.reading import read_fault
from sim_instruments.instrument import Setting
from sim_instruments.keysight_34465a import Keysight34465A as SimulatedMeter
from sim_instruments.truth import Truth
from station.clock import Clock, VirtualClock
from station.readings import Readings
from station.runner.opening import Place

VOLTS = {
    "measures": "accelerometer",
    "noise": "0 ppm",
    "line_frequency": "50 Hz",
    "gain_error": "0 ppm",
    "offset": "0 V",
    "zero_drift_in_one_hour": "36 uV",
}
OHMS = {
    "measures": "pt100",
    "noise": "0 ppm",
    "line_frequency": "50 Hz",
    "gain_error": "0 ppm",
    "offset": "0 ohm",
}


class Room:
    """A world with nothing but a ramp of voltage and a Pt100."""

    def __init__(self, volts: float, slope_V_per_s: float, ohms: float) -> None:
        self.lock = RLock()
        self._volts, self._slope_V_per_s, self._ohms = volts, slope_V_per_s, ohms

    def mean_output_V(self, edges_s: np.ndarray) -> np.ndarray:
        return self._volts + self._slope_V_per_s * (edges_s[1:] + edges_s[:-1]) / 2

    def mean_pt100_ohm(self, edges_s: np.ndarray) -> np.ndarray:
        return np.full(len(edges_s) - 1, self._ohms)


class EmptyRoom:
    """A world in which there is nothing to measure."""

    def __init__(self) -> None:
        self.lock = RLock()


class Stand:
    """A simulated meter that is served in a world, and whoever talks to it."""

    def __init__(self, clock: Clock, truth: dict[str, str], room: Any, *faults: dict[str, Any]):
        self.clock = clock
        self.readings = Readings(clock)
        instrument_faults = InstrumentFaults(Schedule(clock, room.lock))
        rng = np.random.default_rng(1)
        self.meter = SimulatedMeter(
            Setting(
                "multimeter",
                "MY54500001",
                Truth(truth, "simulator"),
                room,
                clock,
                rng,
                0,
                instrument_faults,
            )
        )
        self.instruments = {"multimeter": self.meter.describe()}
        for entry in faults:
            given = {"instrument": "multimeter", **entry}
            read = read_fault(
                given, Truth(given, "fault"), "scpi", [entry["fault"]], clock.now(), rng
            )
            instrument_faults.add(read[0], at_message=read[1])

    def line(self) -> Line:
        return Line(self, "multimeter", self.clock)  # type: ignore[arg-type]

    def place(self, **settings: Any) -> Place:
        return Place(
            "multimeter",
            self.instruments["multimeter"]["address"],
            self.clock,
            settings,
            publisher=self.readings.publisher("multimeter"),
        )

    def at_its_front_panel(self, message: str) -> str | None:
        """Do what somebody else does there; on virtual time the line has room for one client."""
        return self.meter.execute(message)

    def newest(self, quantity: str) -> Any:
        reading = self.readings.newest("multimeter", quantity)
        return None if reading is None else reading.value


@contextmanager
def standing(
    volts: float = 0.5,
    slope: float = 0.0,
    ohms: float = 107.79,
    truth: dict[str, str] = VOLTS,
    faults: tuple[dict[str, Any], ...] = (),
    room: Any = None,
    **changes: str,
) -> Iterator[Stand]:
    clock = VirtualClock()
    with clock.participant("test"):
        stand = Stand(clock, {**truth, **changes}, room or Room(volts, slope, ohms), *faults)
        try:
            yield stand
        finally:
            stand.meter.close()
            clock.stop()
