"""A small world for a simulated voltmeter of either model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import fixture
import numpy as np
from fixture import Fixture

from drivers.keithley.multimeter_dmm6500 import KeithleyDmm6500
from drivers.keysight.multimeter_34465a import Keysight34465A
from sim_instruments.keithley.multimeter_dmm6500 import KeithleyDmm6500 as SimulatedDmm6500
from sim_instruments.keysight.multimeter_34465a import Keysight34465A as SimulatedMeter
from sim_instruments.world import base as world
from station.clock import Clock

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


class Room(world.Room):
    """A world with nothing but a ramp of voltage and a Pt100."""

    def __init__(self, volts: float, slope_V_per_s: float, ohms: float) -> None:
        super().__init__()
        self._volts, self._slope_V_per_s, self._ohms = volts, slope_V_per_s, ohms

    def mean_output_V(self, edges_s: np.ndarray) -> np.ndarray:
        return self._volts + self._slope_V_per_s * (edges_s[1:] + edges_s[:-1]) / 2

    def mean_pt100_ohm(self, edges_s: np.ndarray) -> np.ndarray:
        return np.full(len(edges_s) - 1, self._ohms)


def standing(
    volts: float = 0.5,
    slope: float = 0.0,
    ohms: float = 107.79,
    truth: dict[str, str] = VOLTS,
    faults: tuple[dict[str, Any], ...] = (),
    room: Any = None,
    clock: Clock | None = None,
    **changes: str,
) -> AbstractContextManager[Fixture]:
    """Serve a meter while this thread takes part in time."""
    return fixture.standing(
        "multimeter",
        SimulatedMeter,
        {**truth, **changes},
        room or Room(volts, slope, ohms),
        *faults,
        serial="MY54500001",
        clock=clock,
    )


MODELS: dict[str, tuple[Any, Any, str]] = {
    "34465A": (SimulatedMeter, Keysight34465A, "MY54500001"),
    "DMM6500": (SimulatedDmm6500, KeithleyDmm6500, "04592428"),
}


@contextmanager
def meter(
    model: str,
    *faults: Mapping[str, Any],
    volts: float = 0.5,
    slope: float = 0.0,
    truth: Mapping[str, Any] | None = None,
    **settings: Any,
) -> Iterator[tuple[Fixture, Any]]:
    """Serve a voltmeter of a model and open its driver."""
    simulator, driver, serial = MODELS[model]
    given = {**VOLTS, **(truth or {})}
    room = Room(volts, slope, 100.0)
    with fixture.standing("multimeter", simulator, given, room, *faults, serial=serial) as here:
        opened = driver(here.place(**settings))
        yield here, opened
        opened.close()


def burst(here: Fixture, opened: Any, readings: int) -> Any:
    """Return a burst of readings, polled until it is there."""
    opened.start(readings)
    for _ in range(1000):
        block = opened.fetch()
        if block is not None:
            return block
        here.clock.sleep(0.1)
    raise AssertionError("the burst does not end")
