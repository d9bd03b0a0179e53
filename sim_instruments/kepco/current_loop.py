"""How a supply in current mode drives a coil: at its voltage limit until the current is there.

Kepco BOP-EL/GL guide 228-1699, p.10: dI/dt = (V_limit - R I)/L. Without this loop the coil follows
each set point with its own time constant L/R, as it would follow a voltage.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from sim_instruments.world.currents import CurrentHistory
from sim_instruments.world.piecewise import Array

Pass = tuple[Array, Array, int]


class CurrentLoop:
    """A coil behind a supply's own loop; `ceiling_A` is the voltage limit over R, None without.

    Its verbs are those of `CurrentHistory`.
    """

    def __init__(self, coil: CurrentHistory, ceiling_A: Callable[[], float | None]) -> None:
        self._coil, self._ceiling_A = coil, ceiling_A

    def hold(self, time_s: float, level_A: float) -> None:
        """Hold `level_A` as soon as the voltage limit allows it."""
        self.run(time_s, [], level_A)

    def pulse(self, time_s: float, level_A: float, until_s: float, then_A: float) -> None:
        """Hold `level_A` until `until_s`, then `then_A`."""
        self.run(time_s, [(np.array([level_A]), np.array([until_s - time_s]), 1)], then_A)

    def run(self, time_s: float, passes: Sequence[Pass], then_A: float) -> float:
        """Walk through lists of (levels in A, dwells in s, cycles), then hold `then_A`.

        Returns the time at which the last list ends (infinite when it has no end), in s.
        """
        ceiling_A, tau_s = self._ceiling_A(), self._coil.tau_s
        if ceiling_A is None or tau_s == 0.0:
            return self._coil.run(time_s, passes, then_A)
        present_A = float(self._coil.current(np.array([time_s]))[0])
        driven: list[Pass] = []
        for levels, dwells, cycles in passes:
            first, present_A = steps(levels, dwells, present_A, ceiling_A, tau_s)
            driven.append((*first, 1))
            if cycles != 1:
                later, present_A = steps(levels, dwells, present_A, ceiling_A, tau_s)
                driven.append((*later, max(cycles - 1, 0)))
            if not cycles:
                break
        ends_s = time_s + sum(float(part[1].sum()) * (part[2] or math.inf) for part in driven)
        last, _ = steps(np.array([then_A]), np.array([math.inf]), present_A, ceiling_A, tau_s)
        if len(last[0]) > 1 and math.isfinite(ends_s):
            driven.append((last[0][:1], last[1][:1], 1))
        self._coil.run(time_s, driven, float(last[0][-1]))
        return ends_s


def steps(
    levels_A: Array, dwells_s: Array, present_A: float, ceiling_A: float, tau_s: float
) -> tuple[tuple[Array, Array], float]:
    """Return the levels and dwells that make a coil follow set points, and its current after them.

    Before a set point stands the limit in its direction, for as long as the current is on its way.
    """
    levels: list[float] = []
    dwells: list[float] = []
    for wanted_A, dwell_s in zip(levels_A.tolist(), dwells_s.tolist(), strict=True):
        limit_A = math.copysign(ceiling_A, wanted_A - present_A)
        way_s = 0.0
        if wanted_A != present_A:
            left = (limit_A - wanted_A) / (limit_A - present_A)
            way_s = -tau_s * math.log(left) if 0.0 < left < 1.0 else math.inf
        if way_s < dwell_s:
            levels += [limit_A, wanted_A] if way_s else [wanted_A]
            dwells += [way_s, dwell_s - way_s] if way_s else [dwell_s]
            present_A = wanted_A
        else:
            levels.append(limit_A)
            dwells.append(dwell_s)
            present_A = limit_A + (present_A - limit_A) * math.exp(-dwell_s / tau_s)
    return (np.array(levels), np.array(dwells)), present_A
