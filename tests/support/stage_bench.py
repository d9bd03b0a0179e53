"""A bench with a rotary stage, for the tests of its driver and of its simulator."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from sim_bench import BENCH, Line, ServedInstrument, served

from drivers.newport.esp301 import NewportEsp301 as Driver
from sim_instruments.newport.esp301 import NewportEsp301 as Simulator
from sim_instruments.world.rotation import RotationHistory
from station.clock import VirtualClock

STAGE = "rotary_stage"
LIMITS = {"rate": 20.0, "acceleration": 40.0, "angle_low": -175.0, "angle_high": 365.0}
TRUTH: dict[str, Any] = {
    "encoder_offset": "10 arcsec",
    "encoder_noise": "0.2 arcsec",
    "resolution": "0.1 arcsec",
    "angle_at_start": "33 deg",
    "settling": "0.3 s",
    "maximum_rate": "80 deg/s",
    "maximum_acceleration": "160 deg/s^2",
}


def bench_of(truth: Mapping[str, Any] | None = None, *faults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the raw data of a bench with a stage, its truth changed, with faults of the stage."""
    bench = copy.deepcopy(BENCH)
    bench["instruments"] = {
        STAGE: {
            "driver": "newport-esp301",
            "serial": "B1234",
            "simulator": {**TRUTH, **(truth or {})},
        }
    }
    bench["simulation"]["faults"] = [{"instrument": STAGE, **fault} for fault in faults]
    return bench


class Bench(ServedInstrument):
    """A served bench with a stage, and what a test needs of it."""

    @property
    def rotation(self) -> RotationHistory:
        """Where the axis truly is."""
        rotation: RotationHistory = self.served._axis._rotation
        return rotation

    def driver(self, limits: Mapping[str, float] = LIMITS, **settings: Any) -> Any:
        """Return the driver, opened."""
        return self.opened(limits, **settings)

    def homed(self, **settings: Any) -> Any:
        """Return the driver of a stage that has found its zero."""
        stage = self.driver(**settings)
        stage.home()
        self.wait(stage)
        assert stage.is_homed()
        return stage


@contextmanager
def stage_bench(
    truth: Mapping[str, Any] | None = None, *faults: Mapping[str, Any]
) -> Iterator[Bench]:
    """Serve a bench with a stage while this thread takes part in time."""
    clock = VirtualClock()
    simulators = {"newport-esp301": Simulator}
    with served(clock, bench_of(truth, *faults), simulators=simulators) as simulation:
        yield Bench(clock, simulation, STAGE, Driver)


class RawStage(Line):
    """A raw client: CR ends what it sends, an answer may have several lines."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench.simulation, STAGE, bench.clock)

    def tell(self, text: str) -> None:
        """Send a line that has no answer, and give the controller a millisecond for it."""
        self._send(text.encode("ascii") + b"\r")
        self._clock.sleep(1e-3)

    def lines(self, text: str) -> list[str]:
        """Send a line and return the lines of its answer."""
        return self._lines(self.raw_ask(text.encode("ascii") + b"\r"))

    def more(self) -> list[str]:
        """Return the lines that a held part of a line answers later."""
        assert self._wire.wait(self._clock.now() + 5.0)
        data = self._socket.recv(65536)
        self._wire.received()
        return self._lines(data)

    def _lines(self, data: bytes) -> list[str]:
        answer = data.decode("ascii")
        assert answer.endswith("\r\n")
        return answer.removesuffix("\r\n").split("\r\n")

    def value(self, text: str) -> float:
        """Return the one number that comes back."""
        (answer,) = self.lines(text)
        return float(answer)

    def code(self) -> int:
        """Return the oldest error."""
        return int(self.value("TE?"))
