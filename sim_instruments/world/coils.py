"""The coils of the bench: the field of their geometry, their heating, and what they have carried.

Each axis is a pair of circular windings, ideally one radius apart and with their common normal
along x, y or z of the coil frame. Spacing and normals are off by what the truth says. The field
per ampere is taken once, at the points of interest; it is linear in the current.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.currents import CurrentHistory, mean_products
from sim_instruments.world.piecewise import LONG_AGO_S, Array

AXES = ("x", "y", "z")


def direction_near(axis: str, lean: Truth) -> Array:
    """Return the unit vector near an axis that leans `towards_…` the two others, shape (3,)."""
    direction = np.zeros(3)
    for k, other in enumerate(AXES):
        towards = 0.0 if other == axis else lean.quantity(f"towards_{other}", "rad")
        direction[k] = 1.0 if other == axis else np.tan(towards)
    return np.asarray(direction / np.linalg.norm(direction))


class HelmholtzPair:
    """Two equal circular windings about a common normal through the origin.

    Truth: `radius`, `turns` of each winding, `spacing_error` of the distance relative to the
    radius, `normal`: the angles by which the normal leans towards the two other axes; `reversed`,
    where the poles of its cable are exchanged.
    """

    def __init__(self, axis: str, truth: Truth) -> None:
        self.radius_m = truth.quantity("radius", "mm") * 1e-3
        self.turns = truth.integer("turns", 1)
        self.spacing_m = self.radius_m * (1.0 + truth.quantity("spacing_error", "1"))
        if self.radius_m <= 0 or self.spacing_m <= 0:
            raise SimulationError(f"{truth.where}: radius and spacing must be positive")
        self.normal = direction_near(axis, truth.section("normal"))
        self.sense = -1.0 if truth.switch("reversed") else 1.0

    def field_mT_per_A(self, point_m: Array) -> Array:
        """Return the field of one ampere at a point of the coil frame, shape (3,), in mT."""
        return np.array(
            field_of_windings_mT(
                self.sense * self.turns,
                2.0 * self.radius_m,
                self.spacing_m,
                tuple(self.normal.tolist()),
                tuple(np.asarray(point_m, dtype=float).tolist()),
            )
        )


@lru_cache(maxsize=64)
def field_of_windings_mT(
    ampere_turns: float,
    diameter_m: float,
    spacing_m: float,
    normal: tuple[float, ...],
    point_m: tuple[float, ...],
) -> tuple[float, ...]:
    """Return the field of two windings at a point, mT; taken once, however many benches ask."""
    import magpylib  # where it is used: only some worlds have coils, and it takes its time

    turn, _ = Rotation.align_vectors([normal], [(0.0, 0.0, 1.0)])
    field = np.zeros(3)
    for side in (-0.5, 0.5):
        loop = magpylib.current.Circle(
            current=ampere_turns,
            diameter=diameter_m,
            position=side * spacing_m * np.array(normal),
            orientation=turn,
        )
        field = field + np.asarray(loop.getB(point_m), dtype=float)
    return tuple((field * 1e3).tolist())


def field_matrix_mT_per_A(pairs: list[HelmholtzPair], point_m: Array) -> Array:
    """Return the field at a point per ampere in each pair, shape (3, 3): field by coil, in mT/A."""
    return np.column_stack([pair.field_mT_per_A(point_m) for pair in pairs])


def small_rotation(truth: Truth, key: str) -> Array:
    """Return the rotation matrix that takes coil-frame vectors into a slightly turned frame.

    Truth: below `key` the angles `about_x`, `about_y`, `about_z` of that frame in the coil frame.
    """
    angles = truth.quantities(key, ["about_x", "about_y", "about_z"], "rad")
    return np.asarray(Rotation.from_rotvec(angles).as_matrix(), dtype=float).T


def wiring(truth: Truth) -> Array:
    """Return the matrix from a device's axes to those that it shows, shape (3, 3).

    Truth: below `wiring`, if it is there, which axis an axis shows, such as `{x: y, y: -x}`; each
    its own without it.
    """
    matrix = np.zeros((3, 3))
    section = truth.section("wiring") if "wiring" in truth else None
    for k, axis in enumerate(AXES):
        shows = axis if section is None else section.text(axis, axis)
        if shows.removeprefix("-") not in AXES:
            raise SimulationError(f"{truth.where}.wiring.{axis}: an axis was expected, got {shows}")
        matrix[k, AXES.index(shows.removeprefix("-"))] = -1.0 if shows.startswith("-") else 1.0
    return matrix


class CoilHeat:
    """The temperature of a coil's winding above the room, exact for every history of the current.

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


def coil_report(coil: CurrentHistory, now_s: float) -> dict[str, Any]:
    """Return the state of a coil now and the extremes of its past, as plain data.

    Between two changes of the level the current runs monotonically towards it, fastest at the
    start: the extremes lie at the changes, exactly. `driven_A` is where the current goes if
    nobody intervenes; `largest_slew_A_per_s` times the coil's `time_constant_s` is the largest
    step that the supply ever made against the current.
    """
    changes = coil.breakpoints(LONG_AGO_S, now_s)
    times = np.unique(np.concatenate([changes, [0.0, now_s]]))
    times = times[times <= now_s]
    currents = np.abs(coil.current(times))
    largest = int(currents.argmax())
    report: dict[str, Any] = {
        "current_A": float(coil.current(times[-1:])[0]),
        "driven_A": float(coil.level(times[-1:])[0]),
        "largest_current_A": float(currents[largest]),
        "largest_current_at_s": float(times[largest]),
        "largest_slew_A_per_s": 0.0,
        "largest_slew_at_s": float(times[0]),
        "time_constant_s": coil.tau_s,
        "at_zero_since_s": None,
    }
    if times.size > 1:
        # The level is asked for in the middle, where rounding cannot pick the neighbouring step.
        levels = coil.level(times[:-1] + np.diff(times) / 2)
        slews = np.abs(levels - coil.current(times[:-1])) / coil.tau_s
        fastest = int(slews.argmax())
        report["largest_slew_A_per_s"] = float(slews[fastest])
        report["largest_slew_at_s"] = float(times[fastest])
    # The last change may be this very moment's.
    now_level = abs(report["driven_A"] - report["current_A"]) / coil.tau_s
    if now_level > report["largest_slew_A_per_s"]:
        report["largest_slew_A_per_s"], report["largest_slew_at_s"] = now_level, now_s
    if report["driven_A"] == 0.0:
        report["at_zero_since_s"] = zero_since(coil, times)
    return report


def zero_since(coil: CurrentHistory, times: np.ndarray) -> float:
    """Return since when the supply has driven nothing through the coil, at the last of `times`."""
    if times.size < 2:
        return float(times[-1])
    driven = np.flatnonzero(coil.level(times[:-1] + np.diff(times) / 2) != 0.0)
    return float(times[driven[-1] + 1] if driven.size else times[0])
