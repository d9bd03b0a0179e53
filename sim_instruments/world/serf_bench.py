"""The world of the SERF gyro: a vapour cell in its shield, its coils, its pump and probe light."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.base import IdleCoils
from sim_instruments.world.coils import AXES
from sim_instruments.world.noise import generator
from sim_instruments.world.serf_cell import Cell, Nuclei, axis_of
from sim_instruments.world.serf_trajectory import Course, Physics, Residual, Switches
from sim_instruments.world.trigger_line import TriggerLine

Array = npt.NDArray[np.float64]


GRADIENT = "gradient"
NAMES = (*AXES, GRADIENT)

LONG_AGO_S = -1e6


class Drive(Protocol):
    """The voltage at a coil over all time, constant between its breakpoints."""

    def voltage_V(self, time_s: Array) -> Array:
        """Return the voltage at each time."""
        ...

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return when the voltage changes between two times."""
        ...


def directions(xy_rad: float, xz_rad: float, yz_rad: float) -> Array:
    """Return the unit vectors of the coil axes x, y, z, one a column; ValueError if none fit."""
    cos_xy, cos_xz, cos_yz = np.cos([xy_rad, xz_rad, yz_rad])
    gram = np.array([[1.0, cos_xy, cos_xz], [cos_xy, 1.0, cos_yz], [cos_xz, cos_yz, 1.0]])
    try:
        return np.asarray(np.linalg.cholesky(gram).T)
    except np.linalg.LinAlgError as error:
        raise ValueError("no three axes have these angles between them") from error


class CellCoils:
    """Three field coils and a gradient coil, each driven by a voltage.

    The coil x points along x of the laboratory, the coil y lies in its plane xy, and the three
    angles between the positive axes say the rest.

    Truth (`simulation.serf.coils`): for `x`, `y`, `z` the nominal `constant`, its `error` and the
    `time_constant` of the current; for `gradient` the field gradient `at_1_V` along z, and the
    place of the cell beside the coil's centre, `off_centre`, where the gradient is a field along
    z as well; `angles`: `xy`, `xz`, `yz`, 90 deg for orthogonal axes.
    """

    def __init__(self, truth: Truth) -> None:
        angles = truth.section("angles")
        try:
            self.axes = directions(*(angles.quantity(pair, "rad") for pair in ("xy", "xz", "yz")))
        except ValueError as error:
            raise SimulationError(f"{angles.where}: {error}") from error
        coils = [truth.section(axis) for axis in AXES]
        nominal = np.array([one.quantity("constant", "nT/V") for one in coils])
        self.factors = 1.0 + np.array([one.quantity("error", "1") for one in coils])
        self.nT_per_V = nominal * self.factors
        self.tau_s = np.array([one.quantity("time_constant", "s") for one in coils])
        if np.any(self.tau_s <= 0.0):
            raise SimulationError(f"{truth.where}: time constants must be positive")
        gradient = truth.section(GRADIENT)
        self.nT_per_cm_V = gradient.quantity("at_1_V", "nT/cm")
        self._off_centre_cm = gradient.quantity("off_centre", "mm") * 0.1
        self._drives: dict[str, Drive] = {}

    def drive(self, name: str, history: Drive) -> None:
        """Wire an output to a coil; SimulationError when there is none, or it has one already."""
        if name not in NAMES:
            raise SimulationError(
                f"there is no coil '{name}' at this cell (coils: {', '.join(NAMES)})"
            )
        if name in self._drives:
            raise SimulationError(f"the coil '{name}' of the cell is driven by two outputs")
        self._drives[name] = history

    def changes(self, last_s: float) -> Array:
        """Return when any voltage changes before a time, in order, each once."""
        found = [one.breakpoints(LONG_AGO_S, last_s) for one in self._drives.values()]
        return np.unique(np.concatenate(found)) if found else np.empty(0)

    def voltages_V(self, time_s: Array) -> Array:
        """Return the voltages at x, y, z and the gradient coil, shape (n, 4)."""
        volts = np.zeros((time_s.size, len(NAMES)))
        for k, name in enumerate(NAMES):
            if name in self._drives:
                volts[:, k] = self._drives[name].voltage_V(time_s)
        return volts

    def field_nT(self, voltages_V: Array) -> Array:
        """Return the field of steady currents in x, y, z at the cell, shapes (n, 3)."""
        return np.asarray((voltages_V * self.nT_per_V) @ self.axes.T)

    def gradient_nT_per_cm(self, voltage_V: float) -> float:
        """Return the gradient along z of a steady voltage."""
        return voltage_V * self.nT_per_cm_V

    def gradient_field_nT(self, voltage_V: float) -> Array:
        """Return the field that the gradient coil makes where the cell is, shape (3,)."""
        return np.array([0.0, 0.0, self.gradient_nT_per_cm(voltage_V) * self._off_centre_cm])


CELL_S = 1e-5
BLOCK = 1024


class InstantNoise:
    """White noise that belongs to time itself: the same whoever looks, how often and when.

    One independent value in each 10 us, so that it is white up to 50 kHz.
    """

    def __init__(self, deviation: float, rng: np.random.Generator) -> None:
        self._deviation = deviation
        self._key = rng.integers(0, 2**63, size=2).astype(np.uint64)

    def at(self, time_s: Array) -> Array:
        """Return the noise at each time, same shape."""
        if self._deviation == 0.0 or time_s.size == 0:
            return np.zeros(time_s.shape)
        cells = np.floor(time_s / CELL_S).astype(np.int64)
        numbers, block = np.unique(cells // BLOCK, return_inverse=True)
        draws = np.stack([self._block(k) for k in numbers.tolist()])
        return np.asarray(self._deviation * draws[block.reshape(cells.shape), cells % BLOCK])

    def _block(self, number: int) -> Array:
        counter = np.array([0, 0, 0, number % 2**64], dtype=np.uint64)
        rng = np.random.Generator(np.random.Philox(key=self._key, counter=counter))
        return rng.standard_normal(BLOCK)


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
