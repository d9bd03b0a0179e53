"""Several worlds in one room, each with its device in its own place: one table and one lock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from sim_instruments.truth import Truth
from sim_instruments.world.accelerometer import AccelerometerBench
from sim_instruments.world.base import STRONG_COIL, World
from sim_instruments.world.laser_gyro import LaserGyroBench
from sim_instruments.world.piecewise import Array
from sim_instruments.world.table import Table

Capability = TypeVar("Capability")


class WorldsTogether(World):
    """The worlds whose devices a bench describes.

    `sections` has the kind of world by the section of the truth that describes its device; where an
    instrument could stand in several of them, it stands in the first. A device's power, cables and
    mounting are acts of all worlds that know them.
    """

    def __init__(self, truth: Truth, sections: Mapping[str, type[World]]) -> None:
        super().__init__(truth)
        kinds = [kind for section, kind in sections.items() if section in truth]
        on_table = any(kind.on_table for kind in kinds)
        self.table = Table.of_bench(truth, self._table_changed) if on_table else None
        self._worlds: list[World] = []
        for kind in kinds:
            shared: dict[str, Any] = {"table": self.table} if kind.on_table else {}
            self._worlds.append(kind(truth, **shared))
        for world in self._worlds:
            world.lock = self.lock
            of_world = [STRONG_COIL] if isinstance(world, AccelerometerBench) else []
            if isinstance(world, LaserGyroBench):
                of_world = [name for name in world.currents if name != STRONG_COIL]
            self.currents |= {name: world.currents[name] for name in of_world}
        acts = [act for world in self._worlds for act in world.preparations]
        self.preparations = tuple(dict.fromkeys(acts))

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
        knowing = self.knowing(prompt_id)
        if not knowing or prompt_id in self.acts:
            return super().act(prompt_id, time_s)
        sentences = [world.act(prompt_id, time_s) for world in knowing]
        return sentences[0]

    def knowing(self, prompt_id: str) -> list[World]:
        """Return the worlds that know an act."""
        return [world for world in self._worlds if prompt_id in world.acts]

    def _table_changed(self, time_s: float) -> None:
        for world in self._worlds:
            world.table_changed(time_s)
