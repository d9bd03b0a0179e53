"""The world of the laser-gyro procedure: a three-axis coil, a field probe, a gyro."""

from __future__ import annotations

from threading import RLock
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.base import coil_currents, coil_named
from sim_instruments.world.coils import (
    AXES,
    HelmholtzPair,
    field_matrix_mT_per_A,
    small_rotation,
)
from sim_instruments.world.currents import CurrentHistory, mean_products
from sim_instruments.world.laser_gyro import LaserGyro

Array = npt.NDArray[np.float64]

TURNS = {f"turn-probe-{axis}": axis for axis in AXES}
"""Acts that turn a gaussmeter's probe of one axis, and where to."""


class LaserGyroBench:
    """Currents in the coils, the field they make, and the gyro that feels it.

    `version` rises with every change of what the future holds; whoever computed ahead starts
    again from there. `lock` is held by whoever reads or changes the world. `soft_iron` near the
    gyro may add its share to the field along `x`, `y` and `z` there; the probe does not feel it.
    """

    preparations: ClassVar[tuple[str, ...]] = ("mount", "connect-cables", "dut-power-on")

    def __init__(self, truth: Truth) -> None:
        self.lock = RLock()
        self.version = 0
        self.mounted = True
        self.probe_axis = "x"
        self.gyro_powered = False
        self._gyro_dark = False
        coils = truth.section("coils")
        sections = [coils.section(axis) for axis in AXES]
        self.pairs = [HelmholtzPair(axis, one) for axis, one in zip(AXES, sections, strict=True)]
        self.currents = coil_currents(truth, self._changed)
        # A strong coil, where the bench has one, stands elsewhere and is not felt here.
        self._felt = [self.currents[axis] for axis in AXES]
        self.ambient_mT = np.array(truth.quantities("ambient_field", AXES, "mT"))
        probe_m = np.array(truth.quantities("probe_position", AXES, "mm")) * 1e-3
        self.probe_mT_per_A = field_matrix_mT_per_A(self.pairs, probe_m)
        gyro = truth.section("gyro")
        self.gyro = LaserGyro(gyro)
        mounting = small_rotation(gyro, "mounting_error")
        centre = field_matrix_mT_per_A(self.pairs, np.zeros(3))
        iron = np.diag(1.0 + np.array(gyro.errors("soft_iron", AXES, "1")))
        self.gyro_mT_per_A = mounting @ iron @ centre
        self.gyro_ambient_mT = mounting @ iron @ self.ambient_mT
        if gyro.switch("powered_at_start"):
            self.power_gyro(0.0, True)

    def coil(self, axis: str) -> CurrentHistory:
        """Return the coil of an axis; SimulationError when there is none."""
        return coil_named(self.currents, axis)

    @property
    def dut_powered(self) -> bool:
        """Whether the gyro is switched on."""
        return self.gyro_powered

    def power_gyro(self, time_s: float, on: bool) -> None:
        """Switch the gyro on, which starts its warm-up, or off."""
        self.gyro_powered = on
        self.gyro.heat.switch(time_s, on and not self._gyro_dark)
        self._changed()

    def darken_gyro(self, time_s: float, dark: bool) -> None:
        """Put the gyro's discharge out, or let it come back, whatever its power does."""
        self._gyro_dark = dark
        self.gyro.heat.switch(time_s, self.gyro_powered and not dark)
        self._changed()

    def overheat_gyro(self, time_s: float, rise_K: float) -> None:
        """Make the gyro warmer than it should be, as by a blocked cooling; 0 ends it."""
        self.gyro.overheat(time_s, rise_K)
        self._changed()

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the probe between neighbouring times, shape (intervals, 3)."""
        return np.asarray(self.ambient_mT + self._mean_currents(edges_s) @ self.probe_mT_per_A.T)

    def gyro_angle_arcsec(self, edges_s: Array) -> Array:
        """Return the angle, noise aside, that the gyro turns between neighbouring times."""
        mean_A = self._mean_currents(edges_s)
        field = self.gyro_ambient_mT + mean_A @ self.gyro_mT_per_A.T
        squared = np.zeros_like(field)
        if self.gyro.quadratic.any():
            products = mean_products(self._felt, edges_s)
            matrix, ambient = self.gyro_mT_per_A, self.gyro_ambient_mT
            coil = field - ambient
            squared = (
                ambient**2
                + 2.0 * ambient * coil
                + np.einsum("aj,njk,ak->na", matrix, products, matrix, optimize=True)
            )
        return self.gyro.steady_angle_arcsec(edges_s, field, squared)

    def act(self, prompt_id: str, time_s: float) -> str:
        """Do what a person was asked to do; returns what was done, SimulationError if unknown."""
        with self.lock:
            if prompt_id == "mount":
                self.mounted = True
                return "The simulated gyro stands in the middle of the coils, IA NA LA along x y z."
            if prompt_id == "connect-cables":
                return "The simulated cables were in place."
            if prompt_id == "dut-power-on":
                self.power_gyro(time_s, True)
                return "The simulated gyro was switched on and warms up."
            if prompt_id == "dut-power-off":
                self.power_gyro(time_s, False)
                return "The simulated gyro was switched off."
            if prompt_id in TURNS:
                self.probe_axis = TURNS[prompt_id]
                return f"The simulated probe was turned along {self.probe_axis}."
        raise SimulationError(
            f"the simulated world does not know the act '{prompt_id}' "
            f"(it knows: mount, connect-cables, dut-power-on, dut-power-off, {', '.join(TURNS)})"
        )

    def _mean_currents(self, edges_s: Array) -> Array:
        return np.column_stack([history.mean_current(edges_s) for history in self._felt])

    def _changed(self) -> None:
        self.version += 1
