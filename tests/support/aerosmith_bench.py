"""A bench with an Ideal Aerosmith table, for the tests of its driver and of its simulator."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from sim_bench import BENCH, Line, served
from table_bench import LIMITS, TABLE
from table_bench import Bench as TableBench

from drivers.ideal_aerosmith.rate_table import IdealAerosmithTable as Driver
from sim_instruments.ideal_aerosmith.table import IdealAerosmithTable as Simulator
from station.clock import VirtualClock

NAME = "ideal-aerosmith"
AXIS: dict[str, Any] = {
    "encoder_offset": "5 arcsec",
    "encoder_sine": "1 arcsec",
    "encoder_phase": "30 deg",
    "angle_at_start": "12 deg",
    "unreferenced": True,
}
TRUTH: dict[str, Any] = {
    "maximum_rate": "200 deg/s",
    "maximum_acceleration": "100 deg/s^2",
    "rate_error": "20 ppm",
    "rate_noise": "0.0005 deg/s",
    "encoder_noise": "0.1 arcsec",
    "resolution": "0.00001 deg",
    "tracking_delay": "10 ms",
    "axis_1": AXIS,
}
THREE: dict[str, Any] = {"axis_2": AXIS, "axis_3": {**AXIS, "angle_at_start": "359.9 deg"}}


class Bench(TableBench):
    """A served bench with this table, and what a test needs of it."""

    axes = 1

    @property
    def table(self) -> Any:
        """The simulated table."""
        return self.served

    def driver(self, limits: Mapping[str, float] = LIMITS, **settings: Any) -> Any:
        """Return the driver, opened."""
        return self.opened(limits, **{"axes": self.axes, **settings})


@contextmanager
def aerosmith_bench(
    truth: Mapping[str, Any] | None = None, *faults: Mapping[str, Any]
) -> Iterator[Bench]:
    """Serve a bench with a table while this thread takes part in time."""
    data = copy.deepcopy(BENCH)
    simulator = {**TRUTH, **(truth or {})}
    data["instruments"] = {TABLE: {"driver": NAME, "serial": "untold", "simulator": simulator}}
    data["simulation"]["faults"] = [{"instrument": TABLE, **fault} for fault in faults]
    clock = VirtualClock()
    with served(clock, data, simulators={NAME: Simulator}) as simulation:
        bench = Bench(clock, simulation, TABLE, Driver)
        bench.axes = sum(f"axis_{n}" in simulator for n in (1, 2, 3))
        yield bench


class RawTable(Line):
    """A raw client."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench.simulation, TABLE, bench.clock)

    def says(self, sent: bytes) -> bytes:
        """Return what comes for bytes."""
        return self.raw_ask(sent)
