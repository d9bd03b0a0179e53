"""The alkali of the cell: how its nuclear spin slows precession down, by polarisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

GAMMA_HZ_PER_NT = 28.02495
"""Gyromagnetic ratio of the free electron; the source's 28 nT/Hz is its reciprocal misprinted."""


@dataclass(frozen=True)
class SlowingDown:
    """The factor of a nuclear spin as a quotient of polynomials in P², lowest power first.

    At spin temperature, Appelt et al. 1998; spin exchange in the limit of small P, Happer and Tam
    1977.
    """

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
    def broadening(self) -> float:
        """Gamma_se R_se / w², with w the angular frequency at small polarisation."""
        return (self.at_rest**2 - self.levels**2) / (2.0 * self.at_rest)

    def pull(self, beta_s: float, omega_rad_per_s: Array) -> Array:
        """Return by which share spin exchange speeds tones up, from how it broadens them."""
        spread = self.at_rest**2 - self.levels**2
        return 2.0 * self.levels**2 / spread * (max(beta_s, 0.0) * omega_rad_per_s) ** 2


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


def known_spin(nuclear_spin: float) -> float:
    """Return a nuclear spin whose slowing-down factor is known; ValueError for another."""
    if nuclear_spin not in SPINS:
        raise ValueError("must be 1.5 (K, Rb-87, Na), 2.5 (Rb-85) or 3.5 (Cs)")
    return nuclear_spin
