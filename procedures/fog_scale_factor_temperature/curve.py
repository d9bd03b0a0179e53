"""A scale-factor error as a polynomial of temperature, with its covariance; never extrapolated.

Chebyshev polynomials of the temperature scaled to -1 .. 1: powers of the temperature itself have
normal equations of condition 4e13 at order 4 between -40 and 60 degC, these of about 6.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from .dataset import Array

GRID = 2001
CHECKED = 201


def chebyshev_columns(
    temperature_degC: Array, domain_degC: tuple[float, float], order: int
) -> Array:
    """Return T_0 .. T_order of the scaled temperatures, shape (n, order + 1)."""
    low, high = domain_degC
    scaled = (2.0 * np.asarray(temperature_degC) - low - high) / (high - low)
    return np.asarray(np.polynomial.chebyshev.chebvander(scaled, order))


@dataclass(frozen=True)
class Curve:
    """Coefficients in ppm, lowest order first, of Chebyshev polynomials over a domain in degC.

    `covariance` (k, k) in ppm^2 is type A; `by_bias` (k,) are the coefficients that a gyro bias of
    1 deg/h would make, zero where turns of both senses have told it from the scale factor.`check`
    is what checks of the curve add to its uncertainty: temperatures that rise and standard
    uncertainties in ppm there.
    """

    domain_degC: tuple[float, float]
    coefficients_ppm: Array
    covariance: Array
    degrees_of_freedom: float
    by_bias: Array
    check: tuple[Array, Array] | None = None

    @property
    def order(self) -> int:
        """The order of the polynomial."""
        return len(self.coefficients_ppm) - 1

    def holds(self, temperature_degC: float) -> bool:
        """Whether a temperature is in the domain."""
        low, high = self.domain_degC
        return low <= temperature_degC <= high

    def clamped(self, temperature_degC: Array) -> Array:
        """Return temperatures moved to the nearest end of the domain where they are outside."""
        return np.clip(temperature_degC, *self.domain_degC)

    def columns(self, temperature_degC: Array) -> Array:
        """Return the polynomials at temperatures, clamped to the domain, shape (n, k)."""
        return chebyshev_columns(self.clamped(temperature_degC), self.domain_degC, self.order)

    def error_ppm(self, temperature_degC: Array) -> Array:
        """Return the scale-factor error in ppm, shape (n,)."""
        return np.asarray(self.columns(temperature_degC) @ self.coefficients_ppm)

    def standard_uncertainty_ppm(self, temperature_degC: Array) -> Array:
        """Return its type A standard uncertainty in ppm, shape (n,)."""
        columns = self.columns(temperature_degC)
        return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", columns, self.covariance, columns)))

    def check_ppm(self, temperature_degC: Array) -> Array:
        """Return the standard uncertainty that checks of the curve add, in ppm, shape (n,)."""
        if self.check is None:
            return np.zeros(np.shape(temperature_degC))
        return np.asarray(np.interp(self.clamped(temperature_degC), *self.check))

    def checked(self, added_ppm: Array | float) -> Curve:
        """Return the curve with more uncertainty: at `CHECKED` even temperatures, or at all."""
        grid = self.temperatures_degC(CHECKED)
        return replace(self, check=(grid, np.hypot(self.check_ppm(grid), added_ppm)))

    def error_by_bias_ppm(self, temperature_degC: Array) -> Array:
        """Return what a gyro bias of 1 deg/h adds to the error, in ppm, shape (n,)."""
        return np.asarray(self.columns(temperature_degC) @ self.by_bias)

    def temperatures_degC(self, count: int) -> Array:
        """Return temperatures spread evenly over the domain."""
        return np.linspace(*self.domain_degC, count)

    def largest_at_degC(self) -> float:
        """Return the temperature of the largest magnitude over the domain."""
        grid = self.temperatures_degC(GRID)
        best = int(np.argmax(np.abs(self.error_ppm(grid))))
        if best in {0, GRID - 1}:
            return float(grid[best])
        found = minimize_scalar(
            lambda t: -abs(float(self.error_ppm(np.array([t]))[0])),
            bounds=(grid[best - 1], grid[best + 1]),
            method="bounded",
        )
        return float(found.x)
