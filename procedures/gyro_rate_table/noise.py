"""White noise and rounding from within the records, and the wave that a lean brings per turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.estimation.rate_spectrum import coefficients, noise_variances
from procedures.estimation.reml import Stretch, fit

from .dataset import Array
from .screening import Kept

SHORTEST = 5
LEAN = 0.02
"""Sine of the angle by which the input axis may lean from the table's, as a standard deviation."""


@dataclass(frozen=True)
class Within:
    """What is seen within the records, in deg/h.

    `squares` (2,) are Q² in arcsec² and N² in (deg/h)² s. `normal` (2, 2) and `right` (2,) are the
    normal equations of cosine and sine amplitude of the table's angle, prior included.
    """

    squares: Array
    normal: Array
    right: Array

    def variance(self, length_s: Array) -> Array:
        """Return the variance of means over times (r,)."""
        return np.asarray(self.squares[1] / length_s + 2.0 * self.squares[0] / length_s**2)


def within_records(
    records: Sequence[Kept], interval_s: float, level_deg_per_h: float
) -> Within | None:
    """Return noise and wave of the records; None where none is long enough.

    The noise is that of output less table rate: it holds the encoder's, which a mean shares.
    """
    prior = np.eye(2) / max(LEAN * level_deg_per_h, 1e-3) ** 2
    squares = np.zeros(2)
    normal, right = prior, np.zeros(2)
    for _ in range(2):
        # The wave is small beside a sample's noise: twice is enough.
        amplitude: Array = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
        stretches = [
            stretch for kept in records for stretch in _stretches(kept, interval_s, amplitude)
        ]
        if not stretches:
            return None
        squares = fit(stretches).theta
        sample = float(squares[1] / interval_s + 2.0 * squares[0] / interval_s**2)
        cross, data = np.zeros((2, 2)), np.zeros(2)
        for kept in records:
            waves = kept.waves - kept.waves.mean(axis=0)
            cross += waves.T @ waves
            data += waves.T @ (kept.residual - kept.residual.mean())
        normal, right = prior + cross / max(sample, 1e-12), data / max(sample, 1e-12)
    return Within(squares, normal, right)


def _stretches(kept: Kept, interval_s: float, amplitude: Array) -> list[Stretch]:
    """Return a record's unbroken stretches in cosine coefficients."""
    level = kept.residual - kept.waves @ amplitude
    stretches = []
    for piece in np.split(level, np.flatnonzero(np.diff(kept.index) != 1.0) + 1):
        if len(piece) >= SHORTEST and float(np.ptp(piece)) > 0.0:
            parts = noise_variances(len(piece), interval_s)[:2]
            count = len(piece) - 1
            stretches.append(
                Stretch(coefficients(piece), parts, np.zeros(count), np.zeros((count, 0)))
            )
    return stretches
