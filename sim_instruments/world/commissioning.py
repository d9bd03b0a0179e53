"""The world of a commissioning: the whole bench at once, each device in its own place."""

from __future__ import annotations

from functools import partial
from typing import TypeVar

from sim_instruments.faults.lasting import CONTACTS
from sim_instruments.truth import Truth
from sim_instruments.world.accelerometer import AccelerometerBench
from sim_instruments.world.base import STRONG_COIL, World, nothing
from sim_instruments.world.chamber import Chamber
from sim_instruments.world.contacts import HandContacts
from sim_instruments.world.fog import FogBench
from sim_instruments.world.laser_gyro import LaserGyroBench
from sim_instruments.world.nine_axis import NineAxisBench
from sim_instruments.world.piecewise import Array
from sim_instruments.world.table import Table

Capability = TypeVar("Capability")

SECTIONS: dict[str, type[World]] = {
    "gyro": LaserGyroBench,
    "nine_axis": NineAxisBench,
    "fog": FogBench,
    "accelerometer": AccelerometerBench,
}
"""Where an instrument could stand in several of them, it stands in the first."""


class CommissioningBench(World):
    """The worlds of the methods whose devices a bench describes, with one table and one lock.

    A device's power, cables and mounting are acts of all worlds that know them.
    """

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        kinds = {kind for section, kind in SECTIONS.items() if section in truth}
        on_table = [kind for kind in (FogBench, NineAxisBench) if kind in kinds]
        self.table = Table.of_bench(truth, self._table_changed) if on_table else None
        self._worlds: list[World] = []
        for kind in SECTIONS.values():
            if kind in on_table:
                self._worlds.append(on_table[on_table.index(kind)](truth, self.table))
            elif kind in kinds:
                self._worlds.append(kind(truth))
        for world in self._worlds:
            world.lock = self.lock
            of_world = [STRONG_COIL] if isinstance(world, AccelerometerBench) else []
            if isinstance(world, LaserGyroBench):
                of_world = [name for name in world.currents if name != STRONG_COIL]
            self.currents |= {name: world.currents[name] for name in of_world}
        acts = [act for world in self._worlds for act in world.preparations]
        self.preparations = tuple(dict.fromkeys(acts))
        opened, closed = (partial(self._door, is_open) for is_open in (True, False))
        self.acts["open-door"] = (opened, "The simulated chamber's door was opened.")
        for act in ("close-door", "close-door-again"):
            self.acts[act] = (closed, "The simulated chamber's door was closed.")
        self.contacts = HandContacts()
        for name in CONTACTS:
            for verb, is_open in (("open", True), ("close", False)):
                moved = partial(self._contact, name, is_open)
                text = f"The simulated contact {name} was {'opened' if is_open else 'closed'}."
                self.acts[f"{verb}-contact-{name}"] = (moved, text)
        self.acts["open-contact-thermal_chamber-door"] = self.acts["open-door"]
        self.acts["close-contact-thermal_chamber-door"] = self.acts["close-door"]
        self.acts["reconnect"] = (nothing, "The simulated data cable was put back.")

    def find(self, kind: type[Capability]) -> Capability | None:
        """Return the first of the worlds, or the public part of one, that is a `kind`."""
        parts = (super().find(kind), *(world.find(kind) for world in self._worlds))
        return next((part for part in parts if part is not None), None)

    @property
    def dut_powered(self) -> bool:
        """Whether any device is switched on."""
        return any(world.dut_powered for world in self._worlds)

    def power(self, time_s: float, on: bool) -> None:
        """Switch all devices on or off."""
        for world in self._worlds:
            world.power(time_s, on)

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the probe, which stands in the coils of the laser gyro."""
        coils = self.find(LaserGyroBench)
        if coils is None:
            return super().mean_probe_field_mT(edges_s)
        return coils.mean_probe_field_mT(edges_s)

    def act(self, prompt_id: str, time_s: float) -> str:
        """Do what a person was asked to do, in every world that knows it."""
        knowing = [world for world in self._worlds if prompt_id in world.acts]
        if not knowing or prompt_id in self.acts:
            return super().act(prompt_id, time_s)
        sentences = [world.act(prompt_id, time_s) for world in knowing]
        return sentences[0]

    def _door(self, is_open: bool, time_s: float) -> None:
        chamber = self.find(Chamber)
        if chamber is not None:
            chamber.door(time_s, is_open)

    def _contact(self, name: str, is_open: bool, time_s: float) -> None:
        self.contacts.move(name, is_open)

    def _table_changed(self, time_s: float) -> None:
        for world in self._worlds:
            if isinstance(world, FogBench | NineAxisBench):
                world.table_changed(time_s)
