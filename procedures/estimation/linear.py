"""Least squares: columns that are made strip by strip, solutions, outliers, slopes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = slice | NDArray[np.int64]

BLOCK_ROWS = 2**16
"""Rows of a model that are in memory at once; a record with fewer is one block, made once."""
_RIDGE = 1e-11
MAD_TO_SIGMA = 1.4826
BLOCKS = 60


class Columns:
    """A model's columns, shape (rows, width), made a block of rows at a time by `make`."""

    def __init__(self, rows: int, make: Callable[[Rows], Array]) -> None:
        self.rows = rows
        self._make = make
        self._matrix = make(slice(0, rows)) if rows <= BLOCK_ROWS else None
        self.width = (make(slice(0, 1)) if self._matrix is None else self._matrix).shape[1]

    @classmethod
    def of(cls, matrix: Array) -> Columns:
        """Return a matrix that is there as columns."""
        return cls(len(matrix), lambda rows: matrix[rows])

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Yield all rows in their order, each block with its place."""
        for first in range(0, self.rows, BLOCK_ROWS):
            place = slice(first, min(first + BLOCK_ROWS, self.rows))
            yield place, self.at(place)

    def at(self, rows: Rows) -> Array:
        """Return some rows."""
        return self._make(rows) if self._matrix is None else self._matrix[rows]

    def where(self, mask: NDArray[np.bool_]) -> Columns:
        """Return the rows that a mask (rows,) marks."""
        places = np.flatnonzero(mask)
        return Columns(len(places), lambda rows: self.at(places[rows]))

    def first(self, width: int) -> Columns:
        """Return the first `width` columns."""
        return Columns(self.rows, lambda rows: self.at(rows)[:, :width])

    def times(self, coefficients: Array) -> Array:
        """Return X b for columns X, shape (rows,)."""
        return np.concatenate([combine(block, coefficients) for _, block in self.blocks()])


def combine(columns: Array, coefficients: Array) -> Array:
    """Return X b for columns X (n, k), by one core: see `linear.cross_products`."""
    return np.asarray(np.einsum("ij,j->i", columns, coefficients))


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


def robust_sigma(residuals: Array, floor: float = 0.0) -> float:
    """Return 1.4826 times the median absolute deviation, at least `floor`.

    On quantised data more than half of the residuals may be equal and the deviation is then zero:
    the floor (0.6 of one quantum) keeps honest samples from being thrown out.
    """
    deviation = np.median(np.abs(residuals - np.median(residuals)))
    return max(MAD_TO_SIGMA * float(deviation), floor)


def reject_outliers(
    design: Array | Columns,
    data: Array,
    threshold: float,
    floor: float = 0.0,
    slack: float = 0.0,
    rounds: int = 20,
) -> Mask:
    """Return which samples of `data` are within `threshold` robust sigmas and `slack` of the fit.

    Fit, reject, fit again without the rejected, until nothing changes. A rejected sample comes back
    when the better fit explains it. Stops early rather than leave fewer samples than the model
    needs. Quantised data have a slack of one quantum: rounding moves an honest sample that far, and
    the median deviation does not see it.
    """
    whole = Columns.of(design) if isinstance(design, np.ndarray) else design
    kept = np.ones(len(data), dtype=bool)
    columns = whole.width
    for _ in range(rounds):
        samples = int(kept.sum())
        everything = samples == len(data)
        fit = least_squares(whole if everything else whole.where(kept), data[kept])
        residuals = fit.residuals if everything else data - whole.times(fit.coefficients)
        # The fit has taken some of the scatter away: give it back before judging.
        widen = np.sqrt(samples / max(samples - columns, 1))
        inner = fit.residuals * widen
        sigma = robust_sigma(inner, floor)
        fresh = np.abs(residuals) <= threshold * sigma + slack if sigma > 0.0 else kept
        if int(fresh.sum()) < columns + 3 or bool(np.array_equal(fresh, kept)):
            break
        kept = fresh
    return kept


def slope_with_uncertainty(
    time_s: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[float, float]:
    """Fit a line to block means; return its slope and standard uncertainty per second.

    Arrays have shape (samples,). Block means take the quantisation noise, which is blue, out of
    the uncertainty; a lag-1 correlation of what remains widens it.
    """
    blocks = min(BLOCKS, len(time_s) // 4)
    if blocks < 4:
        return float("nan"), float("inf")
    edges = np.linspace(0, len(time_s), blocks + 1).astype(int)
    counts = np.diff(edges)
    t = np.add.reduceat(time_s, edges[:-1]) / counts
    y = np.add.reduceat(values, edges[:-1]) / counts
    t = t - t.mean()
    slope = float(t @ y / (t @ t))
    residuals = y - y.mean() - slope * t
    variance = float(residuals @ residuals) / (blocks - 2)
    lag1 = float(residuals[1:] @ residuals[:-1]) / max(float(residuals @ residuals), 1e-300)
    widening = (1 + max(lag1, 0.0)) / (1 - min(max(lag1, 0.0), 0.9))
    return slope, float(np.sqrt(variance * widening / (t @ t)))
