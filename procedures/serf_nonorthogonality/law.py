"""How the spins of an alkali vapour fade and turn in a field when the pump light is off.

With P the polarisation, q(P²) the slowing-down factor at spin temperature, n along the field,

    dP_par/dt = -(R/q) P_par, dP_perp/dt = -(R/q + Gamma_se) P_perp, dphi/dt = gamma B/q.

So everything but Gamma_se goes by one clock u, du/dt = q(0)/q(P²): in its time the tone has one
frequency and the baseline one decay. Gamma_se = beta w², by spin exchange, is taken for steady.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .spins import SlowingDown

Array = NDArray[np.float64]

STEPS = 40
DECAYS = 8.0
"""After so many decays of P nothing is left of a square of it."""


def clocks(
    times_s: Sequence[Array],
    spin: SlowingDown,
    square: Array,
    rate_per_s: Array,
    broadening_per_s: Array,
    along: Array,
) -> list[Array]:
    """Return the clock u in s of each shot at its times, each (n,).

    `square` is P² at time zero, `rate_per_s` R/q(0), `broadening_per_s` Gamma_se and `along` the
    square of the cosine between pump light and field, each (shots,). Runge-Kutta of fourth order on
    a grid common to all, cubic between its points.
    """
    last_s = max(float(t[-1]) for t in times_s)
    end_s = min(last_s, DECAYS / float(np.min(rate_per_s)))
    h = end_s / STEPS
    place = np.arange(STEPS + 1) * h
    u, slope = np.zeros((STEPS + 1, len(square))), np.empty((STEPS + 1, len(square)))
    rest = spin.at_rest

    def speed(now: Array, time_s: float) -> Array:
        left = along + (1.0 - along) * np.exp(-2.0 * broadening_per_s * time_s)
        return np.asarray(rest / spin.at(square * np.exp(-2.0 * rate_per_s * now) * left))

    for k in range(STEPS):
        a = speed(u[k], place[k])
        b = speed(u[k] + 0.5 * h * a, place[k] + 0.5 * h)
        c = speed(u[k] + 0.5 * h * b, place[k] + 0.5 * h)
        d = speed(u[k] + h * c, place[k] + h)
        slope[k] = a
        u[k + 1] = u[k] + h / 6.0 * (a + 2.0 * (b + c) + d)
    slope[STEPS] = speed(u[STEPS], place[STEPS])
    return [_between(t, h, u[:, k], slope[:, k]) for k, t in enumerate(times_s)]


def _between(t: Array, h: float, u: Array, slope: Array) -> Array:
    """Return the clock between the points of its grid; after its end it goes on evenly."""
    k = np.clip((t / h).astype(np.int64), 0, len(u) - 2)
    x = t / h - k
    later = np.maximum(x - 1.0, 0.0) * h * slope[-1]
    x = np.minimum(x, 1.0)
    rise = x * x * (3.0 - 2.0 * x)
    bend = x * (1.0 - x) * h * ((1.0 - x) * slope[k] - x * slope[k + 1])
    return np.asarray(u[k] + rise * (u[k + 1] - u[k]) + bend + later)
