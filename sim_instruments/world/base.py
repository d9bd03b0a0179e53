"""What every simulated world has, whatever device stands in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from threading import RLock
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import AXES
from sim_instruments.world.currents import CurrentHistory

STRONG_COIL = "dc"

Array = npt.NDArray[np.float64]


class World(Protocol):
    """The physical truth that the instruments of one bench share.

    `preparations` are the acts that make the world ready for a client who cannot ask for them.
    `version` rises with every change of what the future holds; whoever computed ahead starts
    again from there. `lock` is held by whoever reads or changes the world. `currents` are the
    coils by name.
    """

    preparations: ClassVar[tuple[str, ...]]
    version: int
    currents: dict[str, CurrentHistory]

    @property
    def lock(self) -> AbstractContextManager[object]:
        """The lock of the world."""
        ...

    @property
    def dut_powered(self) -> bool:
        """Whether the device under test is switched on."""
        ...

    def coil(self, axis: str) -> CurrentHistory:
        """Return the coil of a name; SimulationError when there is none."""
        ...

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the gaussmeter's probe between neighbouring times, (n, 3)."""
        ...

    def act(self, prompt_id: str, time_s: float) -> str:
        """Do what a person was asked to do; returns what was done, SimulationError if unknown."""
        ...


def coil_currents(truth: Truth, changed: Callable[[], None]) -> dict[str, CurrentHistory]:
    """Return the coils that a bench has, whether or not the device of this world stands in them.

    Truth: `resistance` and `inductance` below `coils.x`, `.y`, `.z` and below `dc_coil`.
    """
    sections: dict[str, Truth] = {}
    if "coils" in truth:
        coils = truth.section("coils")
        sections = {axis: coils.section(axis) for axis in AXES}
    if "dc_coil" in truth:
        sections[STRONG_COIL] = truth.section("dc_coil")
    return {
        name: CurrentHistory(
            one.quantity("resistance", "ohm"), one.quantity("inductance", "mH") * 1e-3, changed
        )
        for name, one in sections.items()
    }


def coil_named(currents: Mapping[str, CurrentHistory], name: str) -> CurrentHistory:
    """Return the coil of a name; SimulationError, with the names there are, when there is none."""
    if name not in currents:
        known = ", ".join(currents)
        raise SimulationError(f"there is no coil '{name}' in this world (coils: {known})")
    return currents[name]


class IdleCoils:
    """What a world is made of whose device feels no coil of the other benches.

    They stand in the same room; the gaussmeter's probe lies there and feels the ambient field.
    """

    def __init__(self, truth: Truth) -> None:
        self.lock = RLock()
        self.version = 0
        self.currents = coil_currents(truth, self._changed)
        self._ambient_mT = np.array(truth.quantities("ambient_field", AXES, "mT"))

    def coil(self, axis: str) -> CurrentHistory:
        """Return the coil of another bench; SimulationError when there is none."""
        return coil_named(self.currents, axis)

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the gaussmeter's probe, shape (intervals, 3)."""
        return np.tile(self._ambient_mT, (edges_s.size - 1, 1))

    def _changed(self) -> None:
        self.version += 1
