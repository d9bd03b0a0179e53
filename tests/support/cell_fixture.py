"""A simulated vapour cell with an output at each coil, for tests of its world."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from places import SIM
from quick_yaml import load_yaml

from sim_instruments.truth import Truth
from sim_instruments.world.serf import SerfBench
from sim_instruments.world.serf_coils import VoltageHistory

BENCH: dict[str, Any] = load_yaml(SIM.read_text(encoding="utf-8"))
GAMMA = 2 * np.pi * 28.02495
UPRIGHT = {"towards_x": "0 deg", "towards_y": "0 deg", "towards_z": "0 deg"}
NO_EXCHANGE = "1e15 Hz"
R = 240.0

# What stands in the bench file, without its flaws: one field at a time is added by each test.
IDEAL: dict[str, Any] = {
    "gyro_was_running": False,
    "powered_at_start": True,
    "cell__exchange_rate": NO_EXCHANGE,
    "cell__temperature__swing": "0 K",
    "pump__lean": UPRIGHT,
    "pump__leak": "0 %",
    "pump__light_shift": "0 nT",
    "detector__probe": {"axis": "y", "lean": UPRIGHT},
    "detector__offset": "0 V",
    "detector__noise": "0 V",
    "detector__mains__amplitude": "0 V",
    "detector__full_polarisation": "1 V",
    "coils__angles": {"xy": "90 deg", "xz": "90 deg", "yz": "90 deg"},
    **{f"coils__{axis}__error": "0 %" for axis in "xyz"},
    **{f"coils__{axis}__time_constant": "1e-4 us" for axis in "xyz"},
    "coils__gradient__off_centre": "0 mm",
    **{f"residual_field__{axis}": "0 nT" for axis in "xyz"},
    "residual_field__drift_in_one_hour": dict.fromkeys("xyz", "0 nT"),
}

SHOTS = [(s, 0, 0) for s in (1, -1)]
SHOTS += [(s, r, 0) for s in (1, -1) for r in (1, -1)]
SHOTS += [(s, 0, r) for s in (1, -1) for r in (1, -1)]
SHOTS += [(0, s, r) for s in (1, -1) for r in (1, -1)]


class Fixture:
    """A world with an output at each coil; `ideal` unless told otherwise, the pump on from 0 s."""

    def __init__(self, ideal: bool = True, pump: bool = True, **changes: Any) -> None:
        data = copy.deepcopy(BENCH["simulation"])
        for path, value in ((IDEAL if ideal else {}) | changes).items():
            *sections, key = path.split("__")
            place = data["serf"]
            for section in sections:
                place = place[section]
            place[key] = copy.deepcopy(value)
        self.world = SerfBench(Truth(data, "simulation"))
        self.outputs = {name: VoltageHistory() for name in ("x", "y", "z", "gradient")}
        for name, output in self.outputs.items():
            self.world.drive(name, output)
        if pump:
            self.world.pump(0.0, True)

    def field(self, time_s: float, nT: Sequence[float]) -> None:
        """Give the coils what by their nominal constants makes a field."""
        for axis, value in zip("xyz", nT, strict=True):
            self.outputs[axis].set(time_s, value / 20.0)

    def shoot(self, time_s: float, nT: Sequence[float]) -> None:
        """Switch the field on and the pump off at once, and both back after 0.12 s."""
        before = [20.0 * self.outputs[axis].now_V(time_s) for axis in "xyz"]
        self.field(time_s, nT)
        self.world.pump(time_s, False)
        self.field(time_s + 0.12, before)
        self.world.pump(time_s + 0.12, True)

    def spins(self, times: Any) -> np.ndarray:
        return self.world.trajectory.polarisation(np.atleast_1d(np.asarray(times, dtype=float)))

    def seen(self, times: Any) -> np.ndarray:
        return self.world.detector_V(np.atleast_1d(np.asarray(times, dtype=float)))


def turned(spins: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Return the angle by which spins have turned about a field since the first of them, in rad."""
    along = field / np.linalg.norm(field)
    across = spins - np.outer(spins @ along, along)
    first = across[0] / np.linalg.norm(across[0])
    angle = np.arctan2(across @ np.cross(along, first), across @ first)
    return np.unwrap(angle)


def across(spins: np.ndarray, field: np.ndarray) -> np.ndarray:
    along = field / np.linalg.norm(field)
    return np.linalg.norm(spins - np.outer(spins @ along, along), axis=1)
