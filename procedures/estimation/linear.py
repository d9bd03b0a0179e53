"""Linear least squares by the normal equations of a well scaled design."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

Array = NDArray[np.float64]

_RIDGE = 1e-11


@dataclass(frozen=True)
class LinearFit:
    """One least-squares solution: coefficients, inverse normal matrix, residuals, sum of squares.

    `gains[k]` is how much the sum of squares falls when column k joins the columns before it.
    """

    coefficients: Array
    inverse_normal: Array
    residuals: Array
    sum_of_squares: float
    gains: Array


def least_squares(design: Array, data: Array) -> LinearFit:
    """Fit `data` (n,) by the columns of `design` (n, k).

    The columns used here (Legendre polynomials, sines) are bounded by one and nearly orthogonal, so
    the normal equations lose nothing that matters and cost a fifth of a QR. Columns that repeat
    each other share their coefficient (a relative ridge of 1e-11) instead of raising an error.
    """
    scale = np.sqrt(np.einsum("ij,ij->j", design, design))
    scale = np.where(scale > 0.0, scale, 1.0)
    normal = (design.T @ design) / np.outer(scale, scale)
    normal[np.diag_indices_from(normal)] += _RIDGE
    factor = cholesky(normal, lower=True, check_finite=False)
    half = solve_triangular(factor, (design.T @ data) / scale, lower=True, check_finite=False)
    inverse_factor = solve_triangular(factor, np.eye(len(scale)), lower=True, check_finite=False)
    coefficients = (inverse_factor.T @ half) / scale
    residuals = data - design @ coefficients
    return LinearFit(
        coefficients=coefficients,
        inverse_normal=(inverse_factor.T @ inverse_factor) / np.outer(scale, scale),
        residuals=residuals,
        sum_of_squares=float(residuals @ residuals),
        gains=half**2,
    )
