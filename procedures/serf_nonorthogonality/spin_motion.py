"""How the spins of an alkali vapour lie, fade and turn in a field when the pump light is off.

With P the polarisation, q(P²) the slowing-down factor at spin temperature, n along the field,

    dP_par/dt = -(R/q) P_par, dP_perp/dt = -(R/q + Gamma_se) P_perp, dphi/dt = gamma B/q.

So everything but Gamma_se goes by one clock u, du/dt = q(0)/q(P²): in its time the tone has one
frequency and the baseline one decay. Gamma_se = beta w², by spin exchange, is taken for steady.

In the frame of the light the third axis is that of the pump light and the second that of the
probe. The spins begin where the light and the field during pumping left them: a tenth of a
nanotesla turns them by degrees. How much of a shot's signal fades without turning shows that,

    baseline / tone = (s.n) (p.n) / (|s_perp| |p_perp|),

n along the field, s along the spins, p along the probe; the strength of the light drops out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.descent import Place, descend, inverse_of

from .angles import Solution
from .shots import AXES, SlowingDown, single_axis

Array = NDArray[np.float64]
UNTOLD = 0.25
"""Part of a decay: with a larger u the shots do not tell the broadening from the relaxation."""
STEPS = 40
DECAYS = 8.0
"""After so many decays of P nothing is left of a square of it."""
USUAL_LEAN = np.radians(3.0)
"""Standard uncertainty of a lean that no shot tells."""
MAX_STEPS = 20
NUDGE = 1e-6


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


@dataclass(frozen=True)
class Lean:
    """Leans in rad: (4,) of the spins towards the first and second axis, of the probe towards the
    first and third; with their covariance (4, 4).
    """

    rad: Array
    covariance: Array

    @property
    def spins(self) -> Array:
        """The unit vector of the spins at the beginning."""
        return _unit(np.array([self.rad[0], self.rad[1], 1.0]))

    @property
    def probe(self) -> Array:
        """The unit vector of the probe."""
        return _unit(np.array([self.rad[2], 1.0, self.rad[3]]))

    def but(self, number: int, more_rad: float) -> Lean:
        """Return the leans with one of them larger."""
        rad = self.rad.copy()
        rad[number] += more_rad
        return Lean(rad, self.covariance)


NO_LEAN = Lean(np.zeros(4), np.eye(4) * USUAL_LEAN**2)


def directions(gram: Array, pump_axis: str, probe_axis: str) -> Array:
    """Return the unit vectors of the coil axes, rows, in the frame of the light.

    Taken to lie along: the pump light at right angles to the two other coils, the coil that is
    neither pump's nor probe's along the first axis.
    """
    first = single_axis(pump_axis, probe_axis)
    order = [AXES.index(axis) for axis in (first, probe_axis, pump_axis)]
    lower = np.linalg.cholesky(gram[np.ix_(order, order)])
    placed = np.empty((3, 3))
    placed[order] = lower
    return placed


def fields_in_light(commanded_nT: Array, solution: Solution, pump: str, probe: str) -> Array:
    """Return unit vectors (shots, 3) of the fields, residual included, in the light's frame."""
    axes = directions(solution.gram, pump, probe)
    # r holds projections on the axes; the vector with these projections is axes^-1 r.
    rest = np.linalg.solve(axes, solution.residual)
    field = (commanded_nT * solution.scale) @ axes + rest
    return np.asarray(field / np.linalg.norm(field, axis=1)[:, None])


def lean_of(fields: Array, ratio: Array, ratio_u: Array) -> Lean:
    """Return the leans from the baselines over the tones of all shots, (shots,) with their u.

    `fields` (shots, 3) unit vectors. Least squares; what the shots do not tell stays with its usual
    uncertainty. The sign of the detector's gain is not known and chosen by the shots.
    """
    rad = np.zeros(4)
    gain = 1.0 if float(np.sum(_ratios(fields, rad) * ratio / ratio_u**2)) >= 0.0 else -1.0

    def at(rad: Array) -> Place[Array]:
        expected = _ratios(fields, rad)
        nudged = [_ratios(fields, rad + NUDGE * direction) for direction in np.eye(4)]
        left = (gain * ratio - expected) / ratio_u
        slopes = (np.array(nudged) - expected) / NUDGE / ratio_u
        # What is known of the leans beforehand stands beside the shots.
        own = np.column_stack([slopes, np.eye(4) / USUAL_LEAN])
        return Place.of(own, np.concatenate([left, -rad / USUAL_LEAN]), left)

    minimum = descend(at, rad, MAX_STEPS)
    inverse = None if minimum is None else inverse_of(minimum[1].normal)
    if minimum is None or inverse is None:
        return NO_LEAN
    misfit = float(np.sum(minimum[1].what ** 2)) / max(len(ratio) - 4, 1)
    return Lean(minimum[0], inverse * max(misfit, 1.0))


def _ratios(fields: Array, rad: Array) -> Array:
    """Return the baseline over the tone of each shot, (shots,)."""
    along_s = fields @ _unit(np.array([rad[0], rad[1], 1.0]))
    along_p = fields @ _unit(np.array([rad[2], 1.0, rad[3]]))
    across = (1.0 - along_s**2) * (1.0 - along_p**2)
    return np.asarray(along_s * along_p / np.sqrt(np.maximum(across, 1e-12)))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


@dataclass(frozen=True)
class DecayLine:
    """R/q(0) in 1/s and beta in s of decay = R/q(0) + beta w², each with its u."""

    rate_per_s: float
    rate_u: float
    beta_s: float
    beta_u: float


def decay_line(omega: Array, decay: Array, decay_u: Array) -> DecayLine:
    """Return the line of the decays of several shots, each (n,); a baseline has the frequency 0.

    Beta is zero where nothing tells it, or it would be negative; its u is then infinite.
    """
    weight = decay_u**-2
    x = omega**2
    middle = float(weight @ x / weight.sum())
    spread = float(weight @ (x - middle) ** 2)
    mean = float(weight @ decay / weight.sum())
    mean_u = float(weight.sum() ** -0.5)
    if spread > 0.0:
        beta = float(weight @ ((x - middle) * (decay - mean))) / spread
        rate, rate_u = mean - beta * middle, float(np.hypot(mean_u, middle * spread**-0.5))
        if rate_u > UNTOLD * mean:
            return DecayLine(mean, UNTOLD * mean, 0.0, np.inf)
        if beta > 0.0 and rate > 0.0:
            return DecayLine(rate, rate_u, beta, spread**-0.5)
    return DecayLine(mean, mean_u, 0.0, np.inf)
