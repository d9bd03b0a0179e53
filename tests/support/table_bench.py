"""A bench with a turntable, for the tests of its driver and of its simulator."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from sim_bench import BENCH, Line, ServedInstrument, served

from drivers.acutronic.acutrol3000 import Acutrol3000 as Driver
from sim_instruments.acutronic.acutrol3000 import Acutrol3000 as Simulator
from sim_instruments.bench import Maker
from sim_instruments.world.rotation import RotationHistory
from station.clock import VirtualClock

TABLE = "turntable"
LIMITS = {"rate": 110.0, "acceleration": 50.0}
AXIS: dict[str, Any] = {
    "encoder_offset": "5 arcsec",
    "encoder_sine": "1 arcsec",
    "encoder_phase": "30 deg",
    "angle_at_start": "12 deg",
}
TRUTH: dict[str, Any] = {
    "framing": "framed",
    "maximum_rate": "200 deg/s",
    "maximum_acceleration": "100 deg/s^2",
    "rate_error": "20 ppm",
    "rate_noise": "0.0005 deg/s",
    "encoder_noise": "0.1 arcsec",
    "resolution": "0.00001 deg",
    "tracking_delay": "10 ms",
    "settling": "0.5 s",
    "axis_1": AXIS,
    "axis_2": AXIS,
    "axis_3": {**AXIS, "angle_at_start": "359.9 deg"},
}
LIMITED = {**AXIS, "angle_at_start": "10 deg", "low": "-100 deg", "high": "100 deg"}


def table_entry(truth: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the entry of a table in a bench file, its truth changed."""
    return {
        "driver": "acutrol-3000",
        "serial": "A3-0117",
        "simulator": {**TRUTH, **(truth or {})},
    }


class Bench(ServedInstrument):
    """A served bench with a table, and what a test needs of it."""

    framing = "framed"

    def rotation(self, axis: int = 1) -> RotationHistory:
        """Return where an axis truly is."""
        rotation: RotationHistory = self.served.axes[axis].rotation
        return rotation

    def driver(self, limits: Mapping[str, float] = LIMITS, **settings: Any) -> Any:
        """Return the driver, opened."""
        return self.opened(limits, **{"framing": self.framing, **settings})

    def homed(self, *axes: int, limits: Mapping[str, float] = LIMITS, **settings: Any) -> Any:
        """Return the driver with axes closed, the first unless said."""
        table = self.driver(limits, **settings)
        for axis in axes or (1,):
            table.home(axis)
            self.wait(table, axis)
            assert table.is_homed(axis)
        return table

    def wait(self, driver: Any, *axis: int, within_s: float = 1000.0) -> None:
        """Wait until an axis stands still, the first unless said."""
        super().wait(driver, *(axis or (1,)), within_s=within_s)

    def wait_for_rate(self, table: Any, axis: int = 1) -> None:
        """Wait until an axis has its rate."""
        while not table.is_at_rate(axis):
            self.clock.sleep(0.1)


@contextmanager
def table_bench(
    truth: Mapping[str, Any] | None = None, *faults: Mapping[str, Any], maker: Maker = Simulator
) -> Iterator[Bench]:
    """Serve a bench with a table while this thread takes part in time."""
    data = copy.deepcopy(BENCH)
    entry = table_entry(truth)
    data["instruments"] = {TABLE: entry}
    data["simulation"]["faults"] = [{"instrument": TABLE, **fault} for fault in faults]
    clock = VirtualClock()
    with served(clock, data, simulators={"acutrol-3000": maker}) as simulation:
        bench = Bench(clock, simulation, TABLE, Driver)
        bench.framing = str(entry["simulator"]["framing"])
        yield bench


class RawTable(Line):
    """A raw client of either form."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench.simulation, TABLE, bench.clock)

    def framed(self, text: str) -> tuple[int, str]:
        """Send a message and return error code and text."""
        answer = self.raw_ask(text.encode("ascii") + b"\r\n").decode("ascii")
        assert int(answer[4:8]) == len(answer) - 8
        return int(answer[:4]), answer[8:]

    def says(self, text: str) -> str:
        """Send a message that is not refused and return the text of the answer."""
        code, answer = self.framed(text)
        assert code == 0, answer
        return answer
