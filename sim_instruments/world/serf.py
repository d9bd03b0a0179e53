"""The world of the SERF gyro: a vapour cell in its shield, its coils, its pump and probe light."""

from __future__ import annotations

import numpy as np

from sim_instruments.truth import Truth
from sim_instruments.world.base import TriggerLine, World
from sim_instruments.world.coils import AXES
from sim_instruments.world.noise import InstantNoise, generator
from sim_instruments.world.piecewise import Array
from sim_instruments.world.serf_cell import Cell, Nuclei, axis_of
from sim_instruments.world.serf_coils import CellCoils, VoltageHistory
from sim_instruments.world.serf_oven import Oven
from sim_instruments.world.serf_trajectory import Physics, Residual, SpinTrajectory, Switches


class Detector:
    """The probe light after the cell, and its amplifier.

    Truth (`simulation.serf.detector`): `probe` (`axis`, `lean`), the voltage of a fully polarised
    vapour along the probe, `full_polarisation`, the amplifier's `offset` and `noise` (standard
    deviation of a sample), and `mains`: `frequency`, `amplitude`, `phase` of the pick-up.
    """

    def __init__(self, truth: Truth, rng: np.random.Generator) -> None:
        self.probe_axis = axis_of(truth.section("probe"))
        self.full_V = truth.quantity("full_polarisation", "V")
        self._offset_V = truth.quantity("offset", "V")
        mains = truth.section("mains")
        self._mains_V = mains.quantity("amplitude", "V")
        self._mains_rad_per_s = 2.0 * np.pi * mains.quantity("frequency", "Hz")
        self._mains_rad = mains.quantity("phase", "rad")
        self._noise = InstantNoise(truth.quantity("noise", "V"), rng)

    def voltage_V(self, time_s: Array, polarisation: Array, powered: Array) -> Array:
        """Return the voltage at each time; `polarisation` (n, 3), `powered` 0 or 1, (n,).

        Switched off, the amplifier gives noise alone.
        """
        signal = self.full_V * (polarisation @ self.probe_axis)
        mains = self._mains_V * np.sin(self._mains_rad_per_s * time_s + self._mains_rad)
        return np.asarray(powered * (self._offset_V + signal + mains) + self._noise.at(time_s))


class SerfBench(World):
    """Voltages at the cell's coils, light on the vapour, and the voltage of the detector.

    Truth below `simulation.serf`: see the parts. The coils of the other benches stand in the same
    room, outside the shield; the gaussmeter's probe lies there, too, and feels the ambient field.
    `trigger` starts the generators' steps and the shutter. The gyro's own rotation is not felt:
    one degree per second is a field of 1e-4 nT.
    """

    preparations: tuple[str, ...] = (
        "connect-cables",
        "dut-power-on",
        "heat-cell",
        "gyro-at-rest",
    )

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.trigger = TriggerLine()
        serf = truth.section("serf")
        self.coils = CellCoils(serf.section("coils"))
        self.oven = Oven(serf.section("oven")) if "oven" in serf else None
        self.cell = Cell(serf.section("cell"), serf.section("pump"), self.oven)
        self.gyro_was_running = serf.switch("gyro_was_running")
        self.nuclei = Nuclei(
            serf.section("noble_gas"), self.cell.radius_cm, was_running=self.gyro_was_running
        )
        shield = serf.section("residual_field")
        residual_nT = np.array([shield.quantity(axis, "nT") for axis in AXES])
        drift_nT = np.array(shield.quantities("drift_in_one_hour", AXES, "nT"))
        physics = Physics(
            self.cell, self.coils, self.nuclei, Residual(residual_nT, drift_nT / 3600)
        )
        self.trajectory = SpinTrajectory(physics)
        rng = generator(truth.integer("seed", 0), "serf-detector")
        self.detector = Detector(serf.section("detector"), rng)
        self._power = Switches()
        self._powered = self._heated = False
        if serf.switch("powered_at_start"):
            # Just after the earliest time there is, so that it is not the state before any act.
            self._heat(-1e5)
        self.acts = {
            "heat-cell": (
                self._heat,
                "The simulated cell was brought to its working temperature.",
            ),
            "gyro-at-rest": (self._rest, "The simulated gyro rests in inertial space."),
            **self.usual_acts(
                "The simulated SERF gyro was switched on.",
                "The simulated SERF gyro was switched off, and its cell cools down.",
            ),
        }

    @property
    def dut_powered(self) -> bool:
        """Whether the gyro is switched on."""
        return self._powered

    def power(self, time_s: float, on: bool) -> None:
        """Switch the gyro on or off; switched off, its cell cools down, unless a heater is driven.

        Where an instrument drives the heater, its oven says how warm the cell is.
        """
        self._powered = on
        self._heated = self._heated and on
        self._power.switch(time_s, on)
        driven = self.oven is not None and self.oven.driven
        self.trajectory.warm.switch(time_s, self._heated or driven)
        self._changed()

    def drive(self, coil: str, history: VoltageHistory) -> None:
        """Wire a generator's output to the coil x, y, z or gradient of the cell."""
        with self.lock:
            self.coils.drive(coil, history)
            self._changed()

    def pump(self, time_s: float, on: bool) -> None:
        """Let the pump light pass, or block it, from a time on; at first it is blocked."""
        with self.lock:
            self.trajectory.pump.switch(time_s, on)
            self._changed()

    def detector_V(self, times_s: Array) -> Array:
        """Return the detector's voltage at each time, same shape; times ascend."""
        with self.lock:
            polarisation = self.trajectory.polarisation(times_s)
            polarisation *= self.cell.density(times_s)[:, None]
            return self.detector.voltage_V(times_s, polarisation, self._power.at(times_s))

    def _heat(self, time_s: float) -> None:
        self._heated = True
        if self.oven is not None:
            self.oven.hold(time_s)
        self.power(time_s, True)

    def _rest(self, time_s: float) -> None:
        """Let a gyro rest whose detector is on, since its loops can be opened."""
        self.power(time_s, True)
