"""What every simulated world has, whatever device stands in it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from threading import RLock
from typing import ClassVar, TypeVar

import numpy as np

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import AXES
from sim_instruments.world.currents import CurrentHistory
from sim_instruments.world.piecewise import Array

STRONG_COIL = "dc"

DEVICE, CHAMBER = "device", "chamber"
"""What a thermometer may be at: the device under test, and the air around it."""

Capability = TypeVar("Capability")
Temperature = Callable[[Array], Array]
"""Times in s to temperatures in degC, same shape."""
Edge = Callable[[float], None]
Act = tuple[Callable[[float], object], str]
"""What happens at a time when a person does what a prompt asks, and the sentence about it."""


class Room:
    """What simulated instruments stand in: they take of it what they need, by its type.

    `version` rises with every change of what the future holds; whoever computed ahead starts
    again from there. `lock` is held by whoever reads or changes the room.
    """

    def __init__(self) -> None:
        self.lock = RLock()
        self.version = 0

    def find(self, kind: type[Capability]) -> Capability | None:
        """Return this room, or the public part of it, that is a `kind`; None without one.

        `kind` is a class, or a protocol that can be checked at run time.
        """
        parts = (part for name, part in vars(self).items() if not name.startswith("_"))
        return next((part for part in (self, *parts) if isinstance(part, kind)), None)

    def _changed(self) -> None:
        self.version += 1


class World(Room, ABC):
    """The physical truth that the instruments of one bench share.

    `currents` are the coils of the room by name, whether or not the device of this world feels
    them. `acts` says what a person can be asked to do; `preparations` are those that make the
    world ready for a client who cannot ask for them. `temperatures` are those that a thermometer
    can be put at, and `gradients_K` how much warmer the far end of each is than the near one
    (truth: `simulation.gradient`, with `device` and `chamber`; none where it is not given).
    """

    preparations: tuple[str, ...] = ("mount", "connect-cables", "dut-power-on")
    on_table: ClassVar[bool] = False
    """Whether it takes a table that it shares with other worlds."""

    def __init__(self, truth: Truth) -> None:
        super().__init__()
        self.currents = coil_currents(truth, self._changed)
        self.ambient_mT = np.array(truth.quantities("ambient_field", AXES, "mT"))
        self.acts: dict[str, Act] = {}
        self.temperatures: dict[str, Temperature] = {}
        far = truth.errors("gradient", (DEVICE, CHAMBER), "K")
        self.gradients_K = dict(zip((DEVICE, CHAMBER), far, strict=True))

    @property
    @abstractmethod
    def dut_powered(self) -> bool:
        """Whether the device under test is switched on."""

    @abstractmethod
    def power(self, time_s: float, on: bool) -> None:
        """Switch the device under test on or off."""

    def table_changed(self, time_s: float) -> None:
        """Forget what was computed ahead from a time on: the table turns otherwise."""
        self._changed()

    def coil(self, axis: str) -> CurrentHistory:
        """Return the coil of a name; SimulationError, with the names there are, without one."""
        if axis not in self.currents:
            known = ", ".join(self.currents)
            raise SimulationError(f"there is no coil '{axis}' in this world (coils: {known})")
        return self.currents[axis]

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the gaussmeter's probe, shape (intervals, 3).

        It lies in the room and feels the ambient field.
        """
        return np.tile(self.ambient_mT, (edges_s.size - 1, 1))

    def act(self, prompt_id: str, time_s: float) -> str:
        """Do what a person was asked to do; returns what was done, SimulationError if unknown."""
        if prompt_id not in self.acts:
            raise SimulationError(
                f"the simulated world does not know the act '{prompt_id}' "
                f"(it knows: {', '.join(self.acts)}); add it to `acts` of {type(self).__name__}, "
                "or take it out of its `preparations`"
            )
        happens, sentence = self.acts[prompt_id]
        with self.lock:
            happens(time_s)
        return sentence

    def usual_acts(self, switched_on: str, switched_off: str) -> dict[str, Act]:
        """Return the acts of every world: cables and the device's power, with their sentences."""
        return {
            "connect-cables": (nothing, "The simulated cables were in place."),
            "dut-power-on": (lambda time_s: self.power(time_s, True), switched_on),
            "dut-power-off": (lambda time_s: self.power(time_s, False), switched_off),
        }


def nothing(time_s: float) -> None:
    """Change nothing in the world."""


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
            section.quantity("resistance", "ohm"),
            section.quantity("inductance", "mH") * 1e-3,
            changed,
        )
        for name, section in sections.items()
    }


class TriggerLine:
    """The wire of the bench's trigger, low or high; a listener gets each edge and its time, in s.

    Whoever drives it holds the lock of the world, and so does a listener while it is called. A
    listener has a latency of its own; the line has none.
    """

    def __init__(self) -> None:
        self.high = False
        self._on_rise: list[Edge] = []
        self._on_fall: list[Edge] = []

    def listen(self, on_rise: Edge, on_fall: Edge | None = None) -> None:
        """Pass on rising edges from now on, and falling ones where wished, in order of asking."""
        self._on_rise.append(on_rise)
        if on_fall is not None:
            self._on_fall.append(on_fall)

    def rise(self, time_s: float) -> None:
        """Go high at a time; a line that is high already has no edge."""
        if not self.high:
            self.high = True
            for listener in self._on_rise:
                listener(time_s)

    def fall(self, time_s: float) -> None:
        """Go low at a time; a line that is low already has no edge."""
        if self.high:
            self.high = False
            for listener in self._on_fall:
                listener(time_s)
