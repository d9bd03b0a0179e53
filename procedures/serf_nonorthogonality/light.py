"""How pump and probe light lie to the fields, and where the spins point when a shot begins.

In the frame of the light the third axis is that of the pump light and the second that of the
probe. The spins begin where the light and the field during pumping left them: a tenth of a
nanotesla turns them by degrees. How much of a shot's signal fades without turning tells that,

    baseline / tone = (s.n) (p.n) / (|s_perp| |p_perp|),

n along the field, s along the spins, p along the probe; the strength of the light drops out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .angles import Solution
from .shots import AXES, single_axis

Array = NDArray[np.float64]

USUAL_LEAN = np.radians(3.0)
"""Standard uncertainty of a lean that no shot tells."""
MOST_ITERATIONS = 20
NUDGE = 1e-6


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
    prior = np.eye(4) / USUAL_LEAN**2
    for _ in range(MOST_ITERATIONS):
        expected = _ratios(fields, rad)
        slopes = np.column_stack(
            [(_ratios(fields, rad + NUDGE * one) - expected) / NUDGE for one in np.eye(4)]
        )
        weighted = slopes / ratio_u[:, None]
        left = (gain * ratio - expected) / ratio_u
        inverse = np.linalg.inv(weighted.T @ weighted + prior)
        move = inverse @ (weighted.T @ left - prior @ rad)
        rad = rad + move
        if float(np.max(np.abs(move))) < 1e-9:
            break
    misfit = float(left @ left) / max(len(ratio) - 4, 1)
    return Lean(rad, np.asarray(inverse * max(misfit, 1.0)))


def _ratios(fields: Array, rad: Array) -> Array:
    """Return the baseline over the tone of each shot, (shots,)."""
    along_s = fields @ _unit(np.array([rad[0], rad[1], 1.0]))
    along_p = fields @ _unit(np.array([rad[2], 1.0, rad[3]]))
    across = (1.0 - along_s**2) * (1.0 - along_p**2)
    return np.asarray(along_s * along_p / np.sqrt(np.maximum(across, 1e-12)))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
