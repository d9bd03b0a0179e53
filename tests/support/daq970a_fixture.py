"""A small world for a simulated scanner: a device and a chamber, each with a gradient."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import fixture
import numpy as np
from fixture import Fixture

from drivers.keysight.scanner_daq970a import KeysightDaq970A
from sim_instruments.keysight.scanner_daq970a import KeysightDaq970A as SimulatedScanner
from sim_instruments.world import base as world

DEVICE_DEGC, CHAMBER_DEGC, FAR_K = 31.0, 22.0, 0.5
PLACES: Mapping[str, Any] = {"device": 101, "device_far": 102, "chamber": 103}
TRUTH = {
    "modules": {"1": "DAQM901A", "2": "DAQM908A"},
    "line_frequency": "50 Hz",
    "noise": "0 ppm",
    "gain_error": "0 ppm",
    "offset": "0 ohm",
    "channels": {
        "101": {"at": "device", "r0": "100 ohm"},
        "102": {"at": "device", "along": "100 %", "r0": "100 ohm"},
        "103": {"at": "chamber", "along": "50 %", "r0": "100 ohm"},
    },
}


class WarmRoom(world.Room):
    """A world with nothing but temperatures that rise."""

    def __init__(self, K_per_s: float = 0.0) -> None:
        super().__init__()
        self.temperatures = {
            "device": lambda time_s: DEVICE_DEGC + K_per_s * np.asarray(time_s),
            "chamber": lambda time_s: CHAMBER_DEGC + K_per_s * np.asarray(time_s),
        }
        self.gradients_K = {"device": FAR_K, "chamber": 1.0}


@contextmanager
def scanner(
    *faults: Mapping[str, Any],
    truth: Mapping[str, Any] | None = None,
    K_per_s: float = 0.0,
    **settings: Any,
) -> Iterator[tuple[Fixture, KeysightDaq970A]]:
    """Serve a scanner and open its driver."""
    given, room = {**TRUTH, **(truth or {})}, WarmRoom(K_per_s)
    with fixture.standing(
        "thermometer", SimulatedScanner, given, room, *faults, serial="MY58010326"
    ) as here:
        opened = KeysightDaq970A(here.place(**{"places": PLACES, **settings}))
        yield here, opened
        opened.close()
