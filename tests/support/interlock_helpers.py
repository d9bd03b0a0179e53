"""The shipped simulated bench with instruments opened and its interlocks watched."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from quick_yaml import dump_yaml, load_yaml

from station import registry
from station.clock import VirtualClock
from station.files.lookup import BENCHES, find
from station.files.yaml.reading import read_yaml_text
from station.instruments.bench import Bench, bench_of
from station.instruments.opening import open_instruments
from station.runner.session import serve_bench
from station.safety.interlocks.monitor import Monitor
from station.safety.interlocks.reading import watched_in_a_run
from station.safety.readings import Readings

SUPPLY, GAUSSMETER, BOARD, CHAIN = (
    "coil_supply.x",
    "gaussmeter",
    "gyro_acquisition",
    "interlock_chain",
)
SHIPPED: dict[str, Any] = load_yaml(find(BENCHES, "sim").read_text(encoding="utf-8"))
Entry = dict[str, Any]


def bench_with(
    interlocks: Sequence[Entry] | None = None, faults: Sequence[Entry] = (), chain: bool = True
) -> Bench:
    """Return the shipped bench with other interlocks, and faults of the simulated world."""
    data = copy.deepcopy(SHIPPED)
    if interlocks is not None:
        data["interlocks"] = list(interlocks)
    if not chain:
        del data["instruments"][CHAIN]
        data["interlocks"] = [one for one in data["interlocks"] if CHAIN not in str(one)]
    data["simulation"]["faults"] = list(faults)
    return bench_from(dump_yaml(data, sort_keys=False))


def bench_from(text: str) -> Bench:
    """Return the bench of a text; FaultList with every fault."""
    document = read_yaml_text(text, Path("bench.yaml"))
    return bench_of(document, registry.names(registry.DRIVERS))


@dataclass
class Watched:
    """A bench that is open and watched; `made_safe` holds when the monitor did so itself, s."""

    clock: VirtualClock
    simulation: Any
    instruments: dict[str, Any]
    readings: Readings
    monitor: Monitor
    made_safe: list[float] = field(default_factory=list)

    def energise(self, amplitude_A: float = 3.0) -> None:
        """Let a sine run through the x coil."""
        supply = self.instruments[SUPPLY]
        supply.programme_limits()
        supply.load_sine(0.1, amplitude_A)
        supply.start_sine()


@contextmanager
def watched(bench: Bench, *used: str) -> Iterator[Watched]:
    """Open what a run with these instruments would, and watch its interlocks on virtual time."""
    clock = VirtualClock()
    simulation = serve_bench(bench, clock, "rlg-magnetic-sensitivity")
    try:
        with clock.participant("run"):
            simulation.make_ready()
            interlocks = watched_in_a_run(bench.interlocks, used or (SUPPLY, GAUSSMETER, BOARD))
            needed = {*used, *(name for one in interlocks for name in one.instruments)}
            addresses = {name: one["address"] for name, one in simulation.instruments.items()}
            readings = Readings(clock)
            found = open_instruments(bench, needed, addresses, clock, None, None, readings)
            opened = {name: one.instrument for name, one in found.items()}
            fixture: Watched
            monitor = Monitor(
                interlocks,
                opened,
                readings,
                clock,
                lambda: fixture.made_safe.append(clock.now()),
            )
            fixture = Watched(clock, simulation, dict(opened), readings, monitor)
            try:
                yield fixture
            finally:
                monitor.stop()
                monitor.wait_until_stopped()
                for one in opened.values():
                    one.close()
    finally:
        simulation.close()
        clock.stop()
