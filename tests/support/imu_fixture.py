"""A small world with a nine-axis sensor that measures what it is told, and its two drivers."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from fixture import Fixture, opened

from drivers.generic.can_imu import CanImu
from drivers.kvh.imu_1775 import Kvh1775
from sim_instruments.generic.can_imu import CanImu as SimulatedOnCan
from sim_instruments.kvh.imu_1775 import Kvh1775 as SimulatedKvh
from sim_instruments.world.base import Room
from sim_instruments.world.nine_axis import Means

NAME = "imu"
KINDS = ("kvh", "can")
LATENCY_S = 0.02
STRETCH = 1 + 100e-6
TRUTH = {"latency": "20 ms", "clock_error": "100 ppm"}
FIELD_NT = np.array([21000.0, -3456.0, 46789.0])
FORCE_G = np.array([0.25, -0.5, 0.8125])


class Spindle(Room):
    """A spindle whose rates rise with time; the range is 400 deg/s."""

    range_deg_per_s = 400.0

    def __init__(self) -> None:
        super().__init__()
        self.dut_powered = True
        self.rate_deg_per_s = np.array([1.0, -2.0, 3.0])

    def turn(self, *rate_deg_per_s: float) -> None:
        self.rate_deg_per_s = np.array(rate_deg_per_s)
        self.version += 1

    def nine_axis_means(self, edges_s: np.ndarray) -> Means:
        count = edges_s.size - 1
        middle_s = 0.5 * (edges_s[1:] + edges_s[:-1])
        gyro = self.rate_deg_per_s + 0.001 * middle_s[:, None]
        inside = np.abs(gyro) < self.range_deg_per_s
        clipped = np.clip(gyro, -self.range_deg_per_s, self.range_deg_per_s)
        force, field = np.tile(FORCE_G, (count, 1)), np.tile(FIELD_NT, (count, 1))
        return Means(clipped, inside, force, field, 20.0 + 0.01 * middle_s)


def imu(
    kind: str, *faults: Mapping[str, Any], room: Any = None, **truth: Any
) -> AbstractContextManager[tuple[Fixture, Any]]:
    """Serve a sensor of a kind and open its driver."""
    simulator: Any = SimulatedKvh if kind == "kvh" else SimulatedOnCan
    driver: Any = Kvh1775 if kind == "kvh" else CanImu
    given = {**TRUTH, **({"channel": "can0"} if kind == "can" else {}), **truth}
    return opened(NAME, simulator, driver, given, room or Spindle(), *faults)
