"""The coils of the cell: where their axes point, what field a voltage makes, how fast it comes.

The coil x points along x of the laboratory, the coil y lies in its plane xy, and the three angles
between the positive axes say the rest.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import AXES

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
