"""Linear least squares by the normal equations of a well scaled design, block by block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from .columns import Columns, combine

Array = NDArray[np.float64]

__all__ = ["LinearFit", "combine", "cross_products", "least_squares"]

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


def cross_products(columns: Array) -> Array:
    """Return X'X of columns X (n, k), the same on any number of processor cores.

    Tall thin products gain nothing from a threaded library, which shares them out all the same,
    waits ten times longer than it computes, and rounds differently on another machine. In blocks of
    this size it leaves them to one core; the copy keeps it from choosing another routine.
    """
    rows, width = columns.shape
    block = max(16, 200_000 // width**2)
    whole = rows - rows % block
    stack = columns[:whole].reshape(-1, block, width)
    total = (stack.transpose(0, 2, 1) @ stack.copy()).sum(axis=0)
    rest = columns[whole:]
    return np.asarray(total + rest.T @ rest.copy())


def least_squares(design: Array | Columns, data: Array) -> LinearFit:
    """Fit `data` (n,) by the columns of `design` (n, k).

    The columns used here (Legendre polynomials, sines) are bounded by one and nearly orthogonal, so
    the normal equations lose nothing that matters and cost a fifth of a QR. Columns that repeat
    each other share their coefficient (a relative ridge of 1e-11) instead of raising an error. The
    products of blocks of rows add up, so that memory holds a block of the design and no more.
    """
    columns = Columns.of(design) if isinstance(design, np.ndarray) else design
    products = np.zeros((columns.width + 1, columns.width + 1))
    for place, block in columns.blocks():
        products += cross_products(np.column_stack((block, data[place])))
    scale = np.sqrt(np.diag(products)[:-1])
    scale = np.where(scale > 0.0, scale, 1.0)
    normal = products[:-1, :-1] / np.outer(scale, scale)
    normal[np.diag_indices_from(normal)] += _RIDGE
    factor = cholesky(normal, lower=True, check_finite=False)
    half = solve_triangular(factor, products[:-1, -1] / scale, lower=True, check_finite=False)
    inverse_factor = solve_triangular(factor, np.eye(len(scale)), lower=True, check_finite=False)
    coefficients = (inverse_factor.T @ half) / scale
    residuals = data - columns.times(coefficients)
    return LinearFit(
        coefficients=coefficients,
        inverse_normal=(inverse_factor.T @ inverse_factor) / np.outer(scale, scale),
        residuals=residuals,
        sum_of_squares=float(np.einsum("i,i->", residuals, residuals)),
        gains=half**2,
    )
