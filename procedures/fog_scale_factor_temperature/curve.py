"""A scale-factor error as a polynomial of temperature, and its bands; never extrapolated.

Chebyshev polynomials of the temperature scaled to -1 .. 1: powers of the temperature itself have
normal equations of condition 4e13 at order 4 between -40 and 60 degC, these of about 6.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import stdtr, stdtrit

from procedures.estimation.orthogonal import solve_by_qr

from .dataset import Array, AxisTurns

GRID = 2001
CHECKED = 201
OUTSIDE = 0.05
"""Of records; the truth of the others is inside."""
LARGEST_FACTOR = 1e6
SLOPE_DEGC = 0.01


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
    1 deg/h would make, zero where turns of both senses separate it from the scale factor. `check`
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

    def slope_ppm_per_degC(self, temperature_degC: float) -> float:
        """Return by how much the error changes with the temperature; zero beyond the domain."""
        beside = np.array([temperature_degC - SLOPE_DEGC, temperature_degC + SLOPE_DEGC])
        return float(np.diff(self.error_ppm(beside))[0] / (2.0 * SLOPE_DEGC))

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
        lowest = minimize_scalar(
            lambda t: -abs(float(self.error_ppm(np.array([t]))[0])),
            bounds=(grid[best - 1], grid[best + 1]),
            method="bounded",
        )
        return float(lowest.x)


@dataclass(frozen=True)
class Band:
    """How far a curve may lie from the truth: at one temperature, and over all of them at once.

    U of one temperature holds the truth there in 95 % of records. That no part of the curve is
    farther off needs a larger factor. The error over its standard uncertainty is the projection of
    one random vector on a unit vector that moves with temperature; with the length L of the path of
    that unit vector and n degrees of freedom

        P(largest |error| / u > c) <= L/pi (1 + c²/n)^(-n/2) + P(|t_n| > c).

    Source: Hotelling's tube, D. Q. Naiman, Annals of Statistics 14 (1986) 896; J. Sun and C. R.
    Loader, Annals of Statistics 22 (1994) 1328. The bound is reached where the tube does not meet
    itself. `gyro_bias_deg_per_h` is a standard uncertainty; it enters where turns of one sense
    cannot separate the bias from the scale factor.
    """

    curve: Curve
    gyro_bias_deg_per_h: float = 0.0

    def standard_ppm(self, temperature_degC: Array) -> Array:
        """Return the combined standard uncertainty, shape (n,)."""
        own = self.curve.standard_uncertainty_ppm(temperature_degC)
        by_bias = self.curve.error_by_bias_ppm(temperature_degC) * self.gyro_bias_deg_per_h
        return np.asarray(np.hypot(np.hypot(own, by_bias), self.curve.check_ppm(temperature_degC)))

    def expanded_ppm(self, temperature_degC: Array) -> Array:
        """Return U: 95 % at each temperature by itself, shape (n,)."""
        free = self._degrees_of_freedom(temperature_degC)
        return np.asarray(stdtrit(free, 1.0 - OUTSIDE / 2.0) * self.standard_ppm(temperature_degC))

    def whole_ppm(self, temperature_degC: Array) -> Array:
        """Return the half width within which 95 % of whole curves lie, shape (n,)."""
        return self.whole_factor * self.standard_ppm(temperature_degC)

    @cached_property
    def whole_factor(self) -> float:
        """The factor of the standard uncertainty that holds over the whole domain at once."""
        heat = self.curve.temperatures_degC(GRID)
        free = float(np.min(self._degrees_of_freedom(heat)))
        length = self._path_length(heat)

        def too_often(factor: float) -> float:
            path = length / np.pi * np.exp(-free / 2.0 * np.log1p(factor**2 / free))
            return float(path + 2.0 * stdtr(free, -factor) - OUTSIDE)

        return float(brentq(too_often, 0.0, LARGEST_FACTOR))

    def _degrees_of_freedom(self, temperature_degC: Array) -> Array:
        """Return them after Welch and Satterthwaite: the bias's uncertainty has no end of them."""
        own = self.curve.standard_uncertainty_ppm(temperature_degC)
        total = self.standard_ppm(temperature_degC)
        ratio = np.divide(total, own, out=np.ones_like(own), where=own > 0.0)
        return np.asarray(max(self.curve.degrees_of_freedom, 1.0) * ratio**4)

    def _path_length(self, temperature_degC: Array) -> float:
        """Return the length of the path of the unit vector of the curve's error."""
        by_bias = self.curve.by_bias * self.gyro_bias_deg_per_h
        sizes, vectors = np.linalg.eigh(self.curve.covariance + np.outer(by_bias, by_bias))
        root = vectors * np.sqrt(np.maximum(sizes, 0.0))
        path = np.einsum("ij,jk->ik", self.curve.columns(temperature_degC), root)
        norms = np.sqrt(np.einsum("ij,ij->i", path, path))[:, None]
        unit = np.divide(path, norms, out=np.zeros_like(path), where=norms > 0.0)
        steps = np.diff(unit, axis=0)
        return float(np.sum(np.sqrt(np.einsum("ij,ij->i", steps, steps))))


def published_curve(turns: AxisTurns, order: int) -> Curve | None:
    """Return the curve of the published rule: heading difference over 360 deg, fourth order.

    Source: fog-scale-factor-temperature document, step 3. Plain least squares on every turn of the
    published sense; it knows no bias and leaves out no turn. Fitted in scaled temperature, which
    gives the same polynomial as powers of the temperature without their loss of digits. None with
    too few turns.
    """
    forward = turns.sensing & (turns.commanded_deg > 0.0)
    if not bool(forward.any()):
        forward = turns.sensing
    rows = forward & np.isfinite(turns.error_deg) & np.isfinite(turns.temperature_degC)
    heat = turns.temperature_degC[rows]
    if len(np.unique(heat)) <= order:
        return None
    domain = (float(heat.min()), float(heat.max()))
    error_ppm = turns.data_ppm[rows] / turns.turns[rows]
    fit = solve_by_qr(chebyshev_columns(heat, domain, order), error_ppm)
    free = len(heat) - order - 1
    variance = fit.sum_of_squares / free if free > 0 else 0.0
    covariance = variance * fit.inverse_normal
    return Curve(domain, fit.coefficients, covariance, float(free), np.zeros(order + 1))
