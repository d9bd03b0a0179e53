"""The oven of the vapour cell: one thermal mass that loses its heat to the room."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim_instruments.truth import Truth
from sim_instruments.world.piecewise import LONG_AGO_S, Array

FELT_K = 2.0
"""A change of temperature that begins another stretch of the spins' life."""

SHELF = (185.0, 22.5, 80.0, 720.0)
"""Working temperature and room in degC, rise at 10 W in K, time constant in s."""


class Oven:
    """Where the cell's temperature comes from: first-order warming by a heater's power.

    Truth (`simulation.serf.oven`): `working_temperature`, at which the rates of the cell hold,
    `room`, `rise_at_10_W` in the end, `time_constant`. A cell whose heater no instrument drives is
    held at its working temperature by whoever heats it. Who drives it gives `follow`, which brings
    the heat up to a time. Without truth it is one with no cell in it, as on the shelf.
    """

    def __init__(self, truth: Truth | None = None) -> None:
        self.working_degC, self.room_degC, rise_K, self._tau_s = SHELF
        if truth is not None:
            self.working_degC = truth.quantity("working_temperature", "degC")
            self.room_degC = truth.quantity("room", "degC")
            rise_K = truth.positive("rise_at_10_W", "K")
            self._tau_s = truth.positive("time_constant", "s")
        self._rise_K_per_W = rise_K / 10.0
        self._follow: Callable[[float], None] | None = None
        # Of each piece: its start, the temperature then, and the one it goes to.
        self._pieces = [(LONG_AGO_S, self.room_degC, self.room_degC)]
        self._marks: list[tuple[float, float]] = [(LONG_AGO_S, self.room_degC)]

    @property
    def driven(self) -> bool:
        """Whether an instrument drives the heater."""
        return self._follow is not None

    def drive(self, follow: Callable[[float], None]) -> None:
        """Let an instrument drive the heater."""
        self._follow = follow

    def hold(self, time_s: float) -> None:
        """Be at working temperature from a time on, until something else heats it, or nothing."""
        self._begin(time_s, self.working_degC, self.working_degC)

    def heat(self, time_s: float, power_W: float) -> None:
        """Heat with a power from a time on, which no earlier change comes after."""
        start_s, begin, end = self._pieces[-1]
        goes_to = self.room_degC + power_W * self._rise_K_per_W
        if goes_to != end or begin != end:
            self._begin(time_s, self._within(time_s, start_s, begin, end), goes_to)

    def now_degC(self, time_s: float) -> float:
        """Return the temperature at the time to which the heat has been brought, or after."""
        return self._within(time_s, *self._pieces[-1])

    def temperature_degC(self, time_s: Array) -> Array:
        """Return the temperature at each time; times ascend."""
        if self._follow is not None and time_s.size:
            self._follow(float(time_s[-1]))
        pieces = np.array(self._pieces)
        row = pieces[np.maximum(np.searchsorted(pieces[:, 0], time_s, side="right") - 1, 0)]
        fading = np.exp(-np.maximum(time_s - row[:, 0], 0.0) / self._tau_s)
        return np.asarray(row[:, 2] + (row[:, 1] - row[:, 2]) * fading)

    def above_working_K(self, time_s: Array) -> Array:
        """Return by how much the cell is warmer than its working temperature, as its oven goes."""
        return self.temperature_degC(time_s) - self.working_degC

    def changes(self, last_s: float) -> Array:
        """Return before a time when the temperature had changed by what the spins feel."""
        return np.array([time_s for time_s, _ in self._marks[1:] if time_s < last_s])

    def _within(self, time_s: float, start_s: float, begin: float, end: float) -> float:
        return float(end + (begin - end) * np.exp(-max(time_s - start_s, 0.0) / self._tau_s))

    def _begin(self, time_s: float, temperature_degC: float, goes_to_degC: float) -> None:
        if self._pieces[-1][0] == time_s:
            self._pieces.pop()
        self._pieces.append((time_s, temperature_degC, goes_to_degC))
        if abs(temperature_degC - self._marks[-1][1]) >= FELT_K:
            self._marks.append((time_s, temperature_degC))
