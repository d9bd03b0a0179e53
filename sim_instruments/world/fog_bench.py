"""The world of the fibre-optic gyros: a navigator on a three-axis table in a thermal chamber."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from sim_instruments.seeds import generator
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.base import IdleCoils
from sim_instruments.world.chamber import Chamber
from sim_instruments.world.fog_gyro import FogGyros
from sim_instruments.world.fog_navigator import Navigator
from sim_instruments.world.table import Table

Array = npt.NDArray[np.float64]

ACTS = ("mount", "connect-cables", "dut-power-on", "dut-power-off")
BEFORE_ALL_S = -1e5


class FogBench(IdleCoils):
    """A chamber around a table, and on the table a navigator whose gyros feel both.

    Truth below `simulation.fog`: `latitude`, `table`, `chamber`, `gyros` and `navigator` (see the
    parts), `powered_at_start`. The coils of the other benches stand in the same room, and the
    gaussmeter's probe lies there and feels the ambient field.
    """

    preparations: ClassVar[tuple[str, ...]] = ("mount", "connect-cables", "dut-power-on")

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        seed = truth.integer("seed", 0)
        fog = truth.section("fog")
        self.chamber = Chamber(fog.section("chamber"), self._air_changed)
        self.gyros = FogGyros(fog.section("gyros"), self.chamber, seed)
        self.table = Table(fog.section("table"), generator(seed, "table"), self._table_changed)
        latitude_deg = fog.quantity("latitude", "deg")
        self._navigator = Navigator(
            fog.section("navigator"), self.table, self.gyros, latitude_deg, seed
        )
        if fog.switch("powered_at_start"):
            self.power(BEFORE_ALL_S, True)

    @property
    def dut_powered(self) -> bool:
        """Whether the navigator is switched on."""
        return self._navigator.powered

    @property
    def navigator_powered(self) -> bool:
        """Whether the navigator is switched on."""
        return self._navigator.powered

    def power(self, time_s: float, on: bool) -> None:
        """Switch the navigator on or off, which warms its gyros or lets them cool down."""
        with self.lock:
            if on != self.dut_powered:
                self.gyros.heat.switch(time_s, on)
                self._navigator.switch(time_s, on)
                self._navigator.forget_after(time_s)
                self.version += 1

    def align(self, time_s: float, latitude_deg: float) -> None:
        """Let the navigator begin to align at a latitude that it is told; not while it is off."""
        with self.lock:
            self._navigator.align(time_s, latitude_deg)
            self.version += 1

    def aligned(self, time_s: float) -> bool:
        """Return whether the navigator knows its attitude at a time."""
        with self.lock:
            return self._navigator.aligned(time_s)

    def navigator_attitude(self, times_s: Array) -> Array:
        """Return what the navigator takes for heading, pitch and roll, in deg, shape (times, 3).

        Heading from 0 to below 360 deg, clockwise from north. Zeros while it is not aligned.
        """
        with self.lock:
            return self._navigator.attitude_deg(np.asarray(times_s, dtype=np.float64))

    def gyro_temperature_degC(self, times_s: Array) -> Array:
        """Return what the thermometers in the gyros x, y, z read, shape (times, 3)."""
        with self.lock:
            return self.gyros.sensor_degC(np.asarray(times_s, dtype=np.float64))

    def act(self, prompt_id: str, time_s: float) -> str:
        """Do what a person was asked to do; returns what was done, SimulationError if unknown."""
        if prompt_id == "mount":
            return "The simulated navigator stands on the table, its axes along the table's."
        if prompt_id == "connect-cables":
            return "The simulated cables were in place."
        if prompt_id == "dut-power-on":
            self.power(time_s, True)
            return "The simulated navigator was switched on, and its gyros warm up."
        if prompt_id == "dut-power-off":
            self.power(time_s, False)
            return "The simulated navigator was switched off."
        raise SimulationError(
            f"the simulated world does not know the act '{prompt_id}' (it knows: {', '.join(ACTS)})"
        )

    def _air_changed(self, time_s: float) -> None:
        self.gyros.heat.forget_after(time_s)
        self._table_changed(time_s)

    def _table_changed(self, time_s: float) -> None:
        self._navigator.forget_after(time_s)
        self.version += 1
