"""A simulated 33522B in a small world of the tests' own, and who talks to it."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from threading import RLock
from typing import Any

import numpy as np
from sim_bench import Line

from sim_instruments.faults.instrument import InstrumentFaults, Schedule
from sim_instruments.faults.reading import read_fault
from sim_instruments.instrument import Setting
from sim_instruments.keysight_33522b import Keysight33522B as SimulatedGenerator
from sim_instruments.truth import Truth
from sim_instruments.world.trigger_line import TriggerLine
from sim_instruments.world.voltages import VoltageHistory
from station.clock import Clock, VirtualClock
from station.readings import Readings
from station.runner.opening import Place

NAME = "signal_generator.xy"
TRUTH: dict[str, Any] = {
    "coils": {1: "x", 2: "y"},
    "gain_error": {1: "0 %", 2: "0 %"},
    "offset": {1: "0 V", 2: "0 V"},
    "trigger_latency": "105e-9 s",
}
LATENCY_S = 105e-9


class Room:
    """A world with two coils of high impedance and a trigger."""

    def __init__(self) -> None:
        self.lock = RLock()
        self.trigger = TriggerLine()
        self.coils: dict[str, VoltageHistory] = {}

    def drive(self, coil: str, history: VoltageHistory) -> None:
        self.coils[coil] = history

    def volts(self, coil: str, *times_s: float) -> list[float]:
        return self.coils[coil].voltage_V(np.array(times_s)).tolist()


class EmptyRoom:
    """A world in which there is nothing to drive."""

    def __init__(self) -> None:
        self.lock = RLock()


class Stand:
    """A simulated generator that is served in a world, and whoever talks to it."""

    def __init__(
        self, clock: Clock, truth: Mapping[str, Any], room: Any, *faults: dict[str, Any]
    ) -> None:
        self.clock, self.room = clock, room
        self.readings = Readings(clock)
        self.heard: list[str] = []
        instrument_faults = InstrumentFaults(Schedule(clock, room.lock))
        rng = np.random.default_rng(1)
        self.generator = SimulatedGenerator(
            Setting(
                NAME,
                "MY59000101",
                Truth(truth, "simulator"),
                room,
                clock,
                rng,
                0,
                instrument_faults,
            )
        )
        self.instruments = {NAME: self.generator.describe()}
        for entry in faults:
            given = {"instrument": NAME, **entry}
            read = read_fault(
                given, Truth(given, "fault"), "scpi", [entry["fault"]], clock.now(), rng
            )
            instrument_faults.add(read[0], at_message=read[1])

    def line(self) -> Line:
        return Line(self, NAME, self.clock)  # type: ignore[arg-type]

    def place(self, limit_V: float = 9.0, **settings: Any) -> Place:
        return Place(
            NAME,
            self.instruments[NAME]["address"],
            self.clock,
            {"load": "high-impedance", **settings},
            {"voltage": limit_V},
            trace=self._hear,
            publisher=self.readings.publisher(NAME),
        )

    def at_its_front_panel(self, message: str) -> str | None:
        """Do what somebody else does there; on virtual time the line has room for one client."""
        return self.generator.execute(message)

    def rise(self) -> float:
        """Give the trigger now; return when."""
        now_s = self.clock.now()
        with self.room.lock:
            self.room.trigger.rise(now_s)
        return now_s

    def output(self) -> Any:
        reading = self.readings.newest(NAME, "output")
        return None if reading is None else reading.value

    def _hear(self, direction: str, data: bytes) -> None:
        if direction == ">":
            self.heard.append(data.decode())


@contextmanager
def standing(*faults: dict[str, Any], room: Any = None, **changes: Any) -> Iterator[Stand]:
    clock = VirtualClock()
    truth = {**copy.deepcopy(TRUTH), **changes}
    with clock.participant("test"):
        stand = Stand(clock, truth, room or Room(), *faults)
        try:
            yield stand
        finally:
            stand.generator.close()
            clock.stop()
