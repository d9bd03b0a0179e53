"""How warm a coil is that carries a current: heated by I²R, cooled by the room; first order."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import Truth
from sim_instruments.world.currents import LONG_AGO_S, CurrentHistory, mean_products

Array = npt.NDArray[np.float64]


class CoilHeat:
    """The temperature of a coil's winding above the room, exact for every course of the current.

    Truth (`heating` of the coil): `rise_at_100_W`, the rise in the end, and `time_constant`.
    """

    def __init__(self, truth: Truth, current: CurrentHistory) -> None:
        self._current = current
        self._tau_s = truth.quantity("time_constant", "s")
        self._K_per_A2 = truth.quantity("rise_at_100_W", "K") / 100.0 * current.resistance_ohm
        # What lies before the supply's last intervention stays: it is worked out once.
        self._known_s = [LONG_AGO_S]
        self._known_K = [0.0]

    def rise_K(self, time_s: Array) -> Array:
        """Return the rise above the room at each time, same shape, in K."""
        times = np.unique(time_s)
        first = max(bisect_right(self._known_s, times[0]) - 1, 0)
        begin_s, rise = self._known_s[first], self._known_K[first]
        inner = self._current.breakpoints(begin_s, times[-1])
        grid = np.unique(np.concatenate([[begin_s], inner, times]))
        gains, decays = self._driven_K(grid), np.exp(-np.diff(grid) / self._tau_s)
        rises = np.empty(grid.size)
        rises[0] = rise
        for k, (gain, decay) in enumerate(zip(gains.tolist(), decays.tolist(), strict=True)):
            rise = rise * decay + gain
            rises[k + 1] = rise
        keep = (grid > self._known_s[-1]) & (grid <= self._current.changed_s)
        self._known_s += grid[keep].tolist()
        self._known_K += rises[keep].tolist()
        return rises[np.searchsorted(grid, time_s)]

    def _driven_K(self, grid: Array) -> Array:
        """Return what the current adds by the end of each interval without a change of level."""
        span, tau = np.diff(grid), self._current.tau_s
        level = self._current.level(grid[:-1] + span / 2)
        distance = self._current.current(grid[:-1]) - level
        cooled = np.exp(-span / self._tau_s)
        driven = level**2 * (1.0 - cooled)
        for power, share in ((1.0, 2.0 * level * distance), (2.0, distance**2)):
            decayed = np.exp(-span * power / tau)
            driven += share * (decayed - cooled) / (1.0 - power * self._tau_s / tau)
        return np.asarray(self._K_per_A2 * driven)


def mean_current_and_square(current: CurrentHistory, edges_s: Array) -> tuple[Array, Array]:
    """Return the exact means of the current in A and of its square between neighbouring times."""
    return current.mean_current(edges_s), mean_products([current], edges_s)[:, 0, 0]
