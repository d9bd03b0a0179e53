"""The spins of the cell over all time: a chain of stretches between two changes of anything.

Nothing is stepped while nobody looks. A stretch that lasts longer than the spins remember ends in
its steady state, so that only the stretches since the last such one are integrated, and those
only as far as they are looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sim_instruments.world.piecewise import LONG_AGO_S, Array
from sim_instruments.world.serf_cell import DARK_BELOW, Cell, Nuclei
from sim_instruments.world.serf_coils import GRADIENT, NAMES, CellCoils
from sim_instruments.world.serf_integrator import Integrator

Row = npt.NDArray[np.float64]

AHEAD_S = 1.0
"""How far changes are looked for that are planned already."""
SETTLED = 18.0
"""Decay times after which nothing is left of a change."""
KEPT = 64
"""How many stretches keep what has been integrated."""


class Residual(NamedTuple):
    """The field that the shield lets in, with its drift, shapes (3,)."""

    at_start_nT: Array
    drift_nT_per_s: Array

    def field_nT(self, time_s: Array) -> Array:
        """Return the field at each time, shape (n, 3)."""
        since_s = np.maximum(time_s, 0.0)[:, None]
        return np.asarray(self.at_start_nT + since_s * self.drift_nT_per_s)


class Switches:
    """A thing that is on or off, over all time; off at first."""

    def __init__(self) -> None:
        self._times_s = [LONG_AGO_S]
        self._on = [False]

    def switch(self, time_s: float, on: bool) -> None:
        """Be on or off from a time on, whatever was planned from then on."""
        while self._times_s[-1] >= time_s and len(self._times_s) > 1:
            self._times_s.pop()
            self._on.pop()
        if on != self._on[-1]:
            self._times_s.append(time_s)
            self._on.append(on)

    def changes(self, last_s: float) -> Array:
        """Return when it was switched before a time."""
        return np.array([time_s for time_s in self._times_s[1:] if time_s < last_s])

    def at(self, time_s: Array) -> Array:
        """Return 1 where it is on and 0 where it is off, shape (n,)."""
        k = np.maximum(np.searchsorted(self._times_s, time_s, side="right") - 1, 0)
        return np.array(self._on, dtype=float)[k]


class Physics(NamedTuple):
    """What the stretches of one trajectory have in common."""

    cell: Cell
    coils: CellCoils
    nuclei: Nuclei
    residual: Residual


class Stretch:
    """A time in which no voltage, no light and no power changes, however long it lasts."""

    def __init__(self, physics: Physics, row: Row, before: Stretch | None) -> None:
        self._physics = physics
        cell, coils, nuclei, residual = physics
        self.start_s = float(row[0])
        self.volts = row[1 : 1 + len(NAMES)]
        now = np.array([self.start_s])
        pump_on = row[-1] > 0.5
        self._warm = row[-2] > 0.5 and float(cell.density(now)[0]) > DARK_BELOW
        self._before = before
        if before is None:
            self._voltage_left, self.switched_s = np.zeros(3), LONG_AGO_S
            self._nuclear_nT = nuclei.initial_nT
        else:
            self._voltage_left = before.field_volts(now)[0] - self.volts[:3]
            moved = bool(np.any(self.volts != before.volts))
            self.switched_s = self.start_s if moved else before.switched_s
            self._nuclear_nT = before.nuclear_nT(now)[0]
        gradient_V = float(self.volts[NAMES.index(GRADIENT)])
        self._gradient = coils.gradient_nT_per_cm(gradient_V)
        light = cell.light(pump_on)
        self._constant_nT = coils.field_nT(self.volts[None, :3])[0]
        self._constant_nT = self._constant_nT + coils.gradient_field_nT(gradient_V)
        self._nuclei_feel_nT = self._constant_nT + residual.field_nT(now)[0]
        self._constant_nT = self._constant_nT + light * cell.light_shift_nT * cell.pump_axis
        self._rates = cell.rates(self.start_s, light, self._gradient)
        slowest = self._rates.scale * float(cell.factor(np.zeros(1))[0])
        total = self._rates.relaxation + self._rates.pumping
        self.settled_s = self.start_s + SETTLED * slowest / total
        self._integration: Integrator | None = None

    @property
    def steps(self) -> int:
        """How many steps of integration this stretch has needed."""
        return self._integration.steps if self._integration else 0

    def field_volts(self, time_s: Array) -> Array:
        """Return the voltages at x, y, z that would drive the currents of each time, (n, 3)."""
        since = np.maximum(time_s - self.start_s, 0.0)[:, None]
        faded = np.exp(-since / self._physics.coils.tau_s)
        return np.asarray(self.volts[:3] + self._voltage_left * faded)

    def nuclear_nT(self, time_s: Array) -> Array:
        """Return the nuclear field at each time, shape (n, 3)."""
        if not self._nuclear_nT.any():
            return np.zeros((time_s.size, 3))
        since = time_s - max(self.start_s, 0.0)
        return self._physics.nuclei.later(
            self._nuclear_nT, self._nuclei_feel_nT, self._gradient, np.maximum(since, 0.0)
        )

    def field_nT(self, time_s: Array) -> Array:
        """Return the field that the electrons feel, light shift included, shape (n, 3)."""
        moving = self._physics.coils.field_nT(self.field_volts(time_s) - self.volts[:3])
        return np.asarray(moving + self._slow_nT(time_s))

    def mean_field_nT(self, edges_s: Array) -> Array:
        """Return the mean field between neighbouring times, that of the coils exactly, (n, 3)."""
        since = np.maximum(edges_s - self.start_s, 0.0)[:, None]
        left, length = np.exp(-since / self._physics.coils.tau_s), np.diff(edges_s)
        faded = -np.diff(left, axis=0) * self._physics.coils.tau_s / length[:, None]
        moving = self._physics.coils.field_nT(self._voltage_left * faded)
        return np.asarray(moving + self._slow_nT(edges_s[:-1] + 0.5 * length))

    def _slow_nT(self, time_s: Array) -> Array:
        residual = self._physics.residual.field_nT(time_s)
        return np.asarray(self._constant_nT + residual + self.nuclear_nT(time_s))

    def polarisation(self, time_s: Array) -> Array:
        """Return the electrons' polarisation at each time, shape (n, 3)."""
        if not self._warm:
            return np.zeros((time_s.size, 3))
        if self._before is None:
            return self._steady(time_s)
        young = time_s < self.settled_s
        result = np.empty((time_s.size, 3))
        if young.any():
            result[young] = self._begun().polarisation(time_s[young])
        if not young.all():
            result[~young] = self._steady(time_s[~young])
        return result

    def forget(self) -> None:
        """Drop what has been integrated; it comes again, the same, when somebody looks."""
        self._integration = None

    def _steady(self, time_s: Array) -> Array:
        return self._physics.cell.steady(self.field_nT(time_s), self._rates)

    def _begun(self) -> Integrator:
        """Return this stretch's integration, after that of the ones on which it depends."""
        if self._integration is None:
            waiting = [self]
            while (before := waiting[-1]._unsettled_before()) is not None:
                waiting.append(before)
            for stretch in reversed(waiting):
                stretch._integration = stretch._integration or stretch._begin()
        assert self._integration is not None
        return self._integration

    def _unsettled_before(self) -> Stretch | None:
        """Return the stretch before if it has to be integrated first."""
        before = self._before
        if before is None or before._before is None or before._integration is not None:
            return None
        return before if before._warm and self.start_s < before.settled_s else None

    def _begin(self) -> Integrator:
        assert self._before is not None
        now = np.array([self.start_s])
        begin = self._before.polarisation(now)[0]
        strongest = np.linalg.norm(self.field_nT(now)[0] - self._constant_nT)
        return Integrator(
            self._physics.cell,
            self._rates,
            self.mean_field_nT,
            float(strongest + np.linalg.norm(self._constant_nT)),
            self.start_s,
            self.switched_s,
            float(self._physics.coils.tau_s.max()),
            begin,
        )


class SpinTrajectory:
    """The chain of stretches, kept as long as the past stays what it was."""

    def __init__(self, physics: Physics) -> None:
        self._physics = physics
        self.pump, self.warm = Switches(), Switches()
        self._rows = np.empty((0, len(NAMES) + 3))
        self._stretches: list[Stretch] = []
        self._known_until_s = LONG_AGO_S

    @property
    def steps(self) -> int:
        """How many steps of integration the stretches kept have needed."""
        return sum(stretch.steps for stretch in self._stretches)

    def polarisation(self, time_s: Array) -> Array:
        """Return the electrons' polarisation at each time, shape (n, 3)."""
        result = np.zeros((time_s.size, 3))
        for stretch, here in self._at(time_s):
            result[here] = stretch.polarisation(time_s[here])
        return result

    def field_nT(self, time_s: Array) -> Array:
        """Return the field that the electrons feel at each time, shape (n, 3)."""
        result = np.zeros((time_s.size, 3))
        for stretch, here in self._at(time_s):
            result[here] = stretch.field_nT(time_s[here])
        return result

    def nuclear_nT(self, time_s: Array) -> Array:
        """Return the nuclear field at each time, shape (n, 3)."""
        result = np.zeros((time_s.size, 3))
        for stretch, here in self._at(time_s):
            result[here] = stretch.nuclear_nT(time_s[here])
        return result

    def _at(self, time_s: Array) -> Sequence[tuple[Stretch, npt.NDArray[np.bool_]]]:
        """Return the stretches that times lie in, and which of the times lie in each."""
        if time_s.size == 0:
            return []
        self._extend_to(float(time_s.max()))
        owner = np.maximum(np.searchsorted(self._rows[:, 0], time_s, side="right") - 1, 0)
        return [(self._stretches[k], owner == k) for k in np.unique(owner).tolist()]

    def _extend_to(self, last_s: float) -> None:
        """Know the stretches up to a time, and again those that have become others."""
        self._known_until_s = max(self._known_until_s, last_s + AHEAD_S)
        until_s = self._known_until_s
        changes = [
            source.changes(until_s) for source in (self._physics.coils, self.pump, self.warm)
        ]
        if self._physics.cell.oven is not None:
            changes.append(self._physics.cell.oven.changes(until_s))
        starts = np.unique(np.concatenate([[LONG_AGO_S], *changes]))
        # A voltage has risen long before the middle.
        middles = 0.5 * (starts + np.append(starts[1:], max(until_s, starts[-1])))
        volts = self._physics.coils.voltages_V(middles)
        rows = np.column_stack([starts, volts, self.warm.at(middles), self.pump.at(middles)])
        common = min(len(rows), len(self._rows))
        differ = np.any(rows[:common] != self._rows[:common], axis=1)
        same = int(differ.argmax()) if differ.any() else common
        del self._stretches[same:]
        for row in rows[same:]:
            before = self._stretches[-1] if self._stretches else None
            self._stretches.append(Stretch(self._physics, row, before))
        for stretch in self._stretches[:-KEPT]:
            stretch.forget()
        self._rows = rows
