"""How far a curve may lie from the truth: at one temperature, and over all of them at once.

U of one temperature holds the truth there in 95 % of records. That no part of the curve is
farther off needs a larger factor. The error over its standard uncertainty is the projection of one
random vector on a unit vector that moves with temperature; with the length L of the path of that
unit vector and n degrees of freedom

    P(largest |error| / u > c) <= L/pi (1 + c²/n)^(-n/2) + P(|t_n| > c).

Source: Hotelling's tube, D. Q. Naiman, Annals of Statistics 14 (1986) 896; J. Sun and C. R. Loader,
Annals of Statistics 22 (1994) 1328. The bound is reached where the tube does not meet itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit

from .curve import GRID, Curve
from .dataset import Array

OUTSIDE = 0.05
"""Of records; the truth of the others is inside."""
LARGEST_FACTOR = 1e6


@dataclass(frozen=True)
class Band:
    """Uncertainties of a curve, all of one size: `gyro_bias_deg_per_h` is a standard uncertainty.

    The bias enters where turns of one sense cannot tell it from the scale factor.
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
