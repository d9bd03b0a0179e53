"""A small world with a trigger, a detector and pump light, and one instrument that stands in it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from threading import RLock
from typing import Any

import numpy as np
import yaml
from sim_bench import Line

from sim_instruments.faults.instrument import InstrumentFaults, Schedule
from sim_instruments.faults.reading import read_fault
from sim_instruments.instrument import Setting
from sim_instruments.truth import Truth
from sim_instruments.world.trigger_line import TriggerLine
from station.clock import VirtualClock
from station.lookup import BENCHES, find
from station.readings import Readings
from station.runner.opening import Place

Signal = Callable[[np.ndarray], np.ndarray]


class Room:
    """A detector whose signal begins with the last trigger, and a lamp."""

    def __init__(self, signal: Signal) -> None:
        self.lock = RLock()
        self.trigger = TriggerLine()
        self.edges: list[tuple[float, str]] = []
        self.light: list[tuple[float, bool]] = []
        self._signal = signal
        self.trigger.listen(
            lambda time_s: self.edges.append((time_s, "rise")),
            lambda time_s: self.edges.append((time_s, "fall")),
        )

    def detector_V(self, times_s: np.ndarray) -> np.ndarray:
        assert (np.diff(times_s) > 0).all()
        risen_s = np.array([-np.inf, *(time_s for time_s, kind in self.edges if kind == "rise")])
        since_s = times_s - risen_s[np.searchsorted(risen_s, times_s, side="right") - 1]
        return self._signal(np.where(np.isinf(since_s), -1.0, since_s))

    def pump(self, time_s: float, on: bool) -> None:
        self.light.append((time_s, on))


class EmptyRoom:
    """A world of another procedure: neither trigger nor detector nor light."""

    def __init__(self) -> None:
        self.lock = RLock()


class Stand:
    """A served instrument and whoever talks to it."""

    def __init__(
        self,
        clock: VirtualClock,
        name: str,
        maker: Callable[[Setting], Any],
        truth: Mapping[str, Any],
        room: Any,
        *entries: Mapping[str, Any],
    ) -> None:
        self.clock, self.name, self.room = clock, name, room
        self.readings = Readings(clock)
        self.heard: list[tuple[str, bytes]] = []
        rng = np.random.default_rng(1)
        faults = InstrumentFaults(Schedule(clock, room.lock))
        setting = Setting(name, "0", Truth(truth, "simulator"), room, clock, rng, 0, faults)
        self.simulator = maker(setting)
        self.instruments = {name: self.simulator.describe()}
        for entry in entries:
            given = {"instrument": name, **entry}
            protocol = str(self.instruments[name]["protocol"])
            fault = read_fault(
                given, Truth(given, "fault"), protocol, [entry["fault"]], clock.now(), rng
            )
            faults.add(fault[0], at_message=fault[1])

    def place(self, **settings: Any) -> Place:
        return Place(
            self.name,
            self.instruments[self.name]["address"],
            self.clock,
            settings,
            trace=lambda direction, data: self.heard.append((direction, data)),
            publisher=self.readings.publisher(self.name),
        )

    def line(self) -> Line:
        return Line(self, self.name, self.clock)  # type: ignore[arg-type]

    def newest(self, quantity: str) -> Any:
        reading = self.readings.newest(self.name, quantity)
        return None if reading is None else reading.value


@contextmanager
def standing(
    name: str,
    maker: Callable[[Setting], Any],
    truth: Mapping[str, Any],
    room: Any,
    *faults: Mapping[str, Any],
) -> Iterator[Stand]:
    clock = VirtualClock()
    with clock.participant("test"):
        stand = Stand(clock, name, maker, truth, room, *faults)
        try:
            yield stand
        finally:
            stand.simulator.close()
            clock.stop()


def bench_with_only(name: str, driver: str, serial: str, truth: Mapping[str, Any]) -> str:
    """Return the text of a bench file with one instrument in the simulated bench's world."""
    bench = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    entry = {"driver": driver, "serial": serial, "simulator": copy.deepcopy(dict(truth))}
    bench["instruments"] = {name: entry}
    bench["safe_state"] = [{"role": name, "within": "5 s"}]
    bench.pop("interlocks", None)
    return yaml.safe_dump(bench)
