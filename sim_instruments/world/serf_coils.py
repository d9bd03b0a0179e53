"""The coils of the cell and the voltages that drive them: directions, fields, time constants.

An edge takes a generator nanoseconds; that the current comes later is the coil's doing.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import AXES
from sim_instruments.world.piecewise import LONG_AGO_S, Array

GRADIENT = "gradient"
NAMES = (*AXES, GRADIENT)


class VoltageHistory:
    """What one output has given, gives, and will give if nobody intervenes.

    `changed_s` is when somebody last intervened: what lies before it stays as it is.
    """

    def __init__(self) -> None:
        self.changed_s = LONG_AGO_S
        self._times_s = [LONG_AGO_S]
        self._levels_V = [0.0]

    def set(self, time_s: float, level_V: float) -> None:
        """Go to `level_V` at `time_s`, whatever was planned from then on."""
        kept = max(bisect_left(self._times_s, time_s), 1)
        del self._times_s[kept:], self._levels_V[kept:]
        self.changed_s = time_s
        self.then(time_s, level_V)

    def then(self, time_s: float, level_V: float) -> None:
        """Go on to `level_V` at `time_s`, which is later than everything planned before."""
        if level_V != self._levels_V[-1]:
            self._times_s.append(time_s)
            self._levels_V.append(level_V)

    def now_V(self, time_s: float) -> float:
        """Return the voltage at one time, in V."""
        return self._levels_V[max(bisect_right(self._times_s, time_s) - 1, 0)]

    def voltage_V(self, time_s: Array) -> Array:
        """Return the voltage at each time, in V; the shape is that of the times."""
        here = np.searchsorted(np.asarray(self._times_s), time_s, side="right") - 1
        return np.asarray(self._levels_V)[np.maximum(here, 0)]

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return the times between two times at which the level changes, in s."""
        first, last = bisect_right(self._times_s, first_s), bisect_left(self._times_s, last_s)
        return np.array(self._times_s[first:last], dtype=np.float64)


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
        nominal = np.array([coil.quantity("constant", "nT/V") for coil in coils])
        self.factors = 1.0 + np.array([coil.quantity("error", "1") for coil in coils])
        self.nT_per_V = nominal * self.factors
        self.tau_s = np.array([coil.quantity("time_constant", "s") for coil in coils])
        if np.any(self.tau_s <= 0.0):
            raise SimulationError(f"{truth.where}: time constants must be positive")
        gradient = truth.section(GRADIENT)
        self.nT_per_cm_V = gradient.quantity("at_1_V", "nT/cm")
        self._off_centre_cm = gradient.quantity("off_centre", "mm") * 0.1
        self._drives: dict[str, VoltageHistory] = {}

    def drive(self, name: str, history: VoltageHistory) -> None:
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
        times = [drive.breakpoints(LONG_AGO_S, last_s) for drive in self._drives.values()]
        return np.unique(np.concatenate(times)) if times else np.empty(0)

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
