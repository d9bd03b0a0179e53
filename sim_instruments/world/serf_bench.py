"""The world of the SERF gyro: a vapour cell in its shield, its coils, its pump and probe light."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from sim_instruments.seeds import generator
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.base import IdleCoils
from sim_instruments.world.coils import AXES
from sim_instruments.world.serf_cell import Cell
from sim_instruments.world.serf_coils import CellCoils, Drive
from sim_instruments.world.serf_detector import Detector
from sim_instruments.world.serf_nuclei import Nuclei
from sim_instruments.world.serf_trajectory import Course, Physics, Residual, Switches
from sim_instruments.world.trigger_line import TriggerLine

Array = npt.NDArray[np.float64]

ACTS = ("heat-cell", "gyro-at-rest", "connect-cables", "dut-power-on", "dut-power-off")


class SerfBench(IdleCoils):
    """Voltages at the cell's coils, light on the vapour, and the voltage of the detector.

    Truth below `simulation.serf`: see the parts. The coils of the other benches stand in the same
    room, outside the shield; the gaussmeter's probe lies there, too, and feels the ambient field.
    `trigger` starts the generators' steps and the shutter. The gyro's own rotation is not felt:
    one degree per second is a field of 1e-4 nT.
    """

    preparations: ClassVar[tuple[str, ...]] = (
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
        self.cell = Cell(serf.section("cell"), serf.section("pump"))
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
        self.course = Course(physics)
        rng = generator(truth.integer("seed", 0), "serf-detector")
        self.detector = Detector(serf.section("detector"), rng)
        self._power = Switches()
        self.dut_powered = False
        self._heated = False
        if serf.switch("powered_at_start"):
            # Just after the earliest time there is, so that it is not the state before any act.
            self._heated = True
            self._switch_power(-1e5, True)

    def drive(self, coil: str, history: Drive) -> None:
        """Wire a generator's output to the coil x, y, z or gradient of the cell."""
        with self.lock:
            self.coils.drive(coil, history)
            self._changed()

    def pump(self, time_s: float, on: bool) -> None:
        """Let the pump light pass, or block it, from a time on; at first it is blocked."""
        with self.lock:
            self.course.pump.switch(time_s, on)
            self._changed()

    def detector_V(self, times_s: Array) -> Array:
        """Return the detector's voltage at each time, same shape; times ascend."""
        with self.lock:
            polarisation = self.course.polarisation(times_s)
            return self.detector.voltage_V(times_s, polarisation, self._power.at(times_s))

    def act(self, prompt_id: str, time_s: float) -> str:
        """Do what a person was asked to do; returns what was done, SimulationError if unknown."""
        with self.lock:
            if prompt_id == "heat-cell":
                self._heated = True
                self._switch_power(time_s, True)
                return "The simulated cell was brought to its working temperature."
            if prompt_id == "gyro-at-rest":
                return "The simulated gyro rests in inertial space."
            if prompt_id == "connect-cables":
                return "The simulated cables were in place."
            if prompt_id == "dut-power-on":
                self._switch_power(time_s, True)
                return "The simulated SERF gyro was switched on."
            if prompt_id == "dut-power-off":
                self._heated = False
                self._switch_power(time_s, False)
                return "The simulated SERF gyro was switched off, and its cell cools down."
        raise SimulationError(
            f"the simulated world does not know the act '{prompt_id}' (it knows: {', '.join(ACTS)})"
        )

    def _switch_power(self, time_s: float, on: bool) -> None:
        self.dut_powered = on
        self._power.switch(time_s, on)
        self.course.warm.switch(time_s, on and self._heated)
        self._changed()
