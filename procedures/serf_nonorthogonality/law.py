"""How the spins of an alkali vapour slow down, fade and turn in a field after the pump light.

With P the polarisation, q(P²) the slowing-down factor at spin temperature, n along the field,

    dP_par/dt = -(R/q) P_par, dP_perp/dt = -(R/q + Gamma_se) P_perp, dphi/dt = gamma B/q.

So everything but Gamma_se goes by one clock u, du/dt = q(0)/q(P²): in its time the tone has one
frequency and the baseline one decay. For q see Appelt et al. 1998; for spin exchange, which adds
Gamma_se = beta w² and speeds the tone up, Happer and Tam 1977 in the limit of small P.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS = 80
DECAYS = 8.0
"""After so many decays of P nothing is left of a square of it."""


@dataclass(frozen=True)
class SlowingDown:
    """The factor of a nuclear spin as a quotient of polynomials in P², lowest power first."""

    above: tuple[float, ...]
    below: tuple[float, ...]
    levels: int
    """2 I + 1."""

    def at(self, square: Array) -> Array:
        """Return the factor at polarisations squared, any shape."""
        return _polynomial(self.above, square) / _polynomial(self.below, square)

    @property
    def at_rest(self) -> float:
        """The factor without polarisation, the largest."""
        return self.above[0] / self.below[0]

    @property
    def polarised(self) -> float:
        """The factor of the fully polarised vapour, the smallest."""
        return sum(self.above) / sum(self.below)

    @property
    def broadening_Hz_s(self) -> float:
        """Gamma_se R_se / w², with w the angular frequency at small polarisation."""
        return float((self.at_rest**2 - self.levels**2) / (2.0 * self.at_rest))

    def pull(self, beta_s: float, omega_rad_per_s: Array) -> Array:
        """Return by which share spin exchange speeds tones up, from how it broadens them."""
        spread = self.at_rest**2 - self.levels**2
        share = 2.0 * self.levels**2 / spread * (max(beta_s, 0.0) * omega_rad_per_s) ** 2
        return np.asarray(share)


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    total = coefficients[-1] * x + coefficients[-2]
    for one in coefficients[-3::-1]:
        total = total * x + one
    return total


SPINS = {
    1.5: SlowingDown((6.0, 2.0), (1.0, 1.0), 4),
    2.5: SlowingDown((38.0, 52.0, 6.0), (3.0, 10.0, 3.0), 6),
    3.5: SlowingDown((22.0, 70.0, 34.0, 2.0), (1.0, 7.0, 7.0, 1.0), 8),
}
"""By nuclear spin: potassium and rubidium-87, rubidium-85, caesium."""


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
