"""A simulated signal generator in a small world of the tests' own, and who talks to it."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from fixture import Fixture as AnyFixture
from fixture import serving

from drivers.keysight.generator_33522b import Keysight33522B
from drivers.rigol.generator_dg800 import RigolDg800
from sim_instruments.keysight.generator_33522b import Keysight33522B as SimulatedGenerator
from sim_instruments.rigol.generator_dg800 import RigolDg800 as SimulatedDg800
from sim_instruments.world import base as world
from sim_instruments.world.base import TriggerLine
from sim_instruments.world.serf_coils import VoltageHistory
from station.clock import Clock
from station.instruments.opening import InstrumentPlace

NAME = "signal_generator.xy"
TRUTH: dict[str, Any] = {
    "coils": {1: "x", 2: "y"},
    "gain_error": {1: "0 %", 2: "0 %"},
    "offset": {1: "0 V", 2: "0 V"},
    "trigger_latency": "105e-9 s",
}
LATENCY_S = 105e-9


class Room(world.Room):
    """A world with two coils of high impedance and a trigger."""

    def __init__(self) -> None:
        super().__init__()
        self.trigger = TriggerLine()
        self.coils: dict[str, VoltageHistory] = {}

    def drive(self, coil: str, history: VoltageHistory) -> None:
        self.coils[coil] = history

    def volts(self, coil: str, *times_s: float) -> list[float]:
        return self.coils[coil].voltage_V(np.array(times_s)).tolist()


MODELS: dict[str, tuple[Any, Any, str]] = {
    "33522B": (SimulatedGenerator, Keysight33522B, "MY59000101"),
    "DG822": (SimulatedDg800, RigolDg800, "DG8A262000837"),
}


class Fixture(AnyFixture):
    """A simulated generator that is served in a world, and whoever talks to it."""

    def __init__(
        self,
        clock: Clock,
        truth: Mapping[str, Any],
        room: Any,
        *faults: Mapping[str, Any],
        model: str = "33522B",
    ) -> None:
        maker, self.driver, serial = MODELS[model]
        super().__init__(clock, NAME, maker, truth, room, *faults, serial=serial)

    def place(self, limits: Mapping[str, float] | None = None, **settings: Any) -> InstrumentPlace:
        given = {"load": "high-impedance", **settings}
        return super().place({"voltage": 9.0} if limits is None else limits, **given)

    def volts(self, coil: str, *after_s: float) -> list[float]:
        """Return the voltages at a coil so long after now; now, unless said."""
        return [self.room.volts(coil, self.clock.now() + s)[0] for s in after_s or (0.0,)]

    def rise(self) -> float:
        """Give the trigger now; return when."""
        now_s = self.clock.now()
        with self.room.lock:
            self.room.trigger.rise(now_s)
        return now_s


def standing(
    *faults: dict[str, Any], room: Any = None, model: str = "33522B", **changes: Any
) -> AbstractContextManager[Fixture]:
    """Serve a generator while this thread takes part in time."""
    truth = {**copy.deepcopy(TRUTH), **changes}
    return serving(lambda clock: Fixture(clock, truth, room or Room(), *faults, model=model))


@contextmanager
def generator(
    model: str, *faults: Any, limit_V: float = 9.0, load: str = "high-impedance", **truth: Any
) -> Iterator[tuple[Fixture, Any]]:
    """Serve a generator of a model and open its driver."""
    with standing(*faults, model=model, **truth) as fixture:
        driver = fixture.driver(fixture.place({"voltage": limit_V}, load=load))
        yield fixture, driver
        driver.close()
