"""Weighted least squares by QR, and which columns of a design are independent of those before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .linear import combine, cross_products

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAD_TO_SIGMA = 1.4826
FEWEST_BLOCK_ROWS = 48
CHARGE = 1.4
"""Times ln(rows) for a column: white noise is then taken for a term once in some hundreds."""


def thin_qr(columns: Array) -> tuple[Array, Array]:
    """Return Q (n, k) and R (k, k) of columns (n, k), the same on any number of processor cores.

    Blocks of rows are decomposed, then their triangles. A threaded library shares a tall thin
    decomposition out among the cores and waits forty times longer than it computes; small blocks
    it leaves to one.
    """
    rows, width = columns.shape
    block = max(FEWEST_BLOCK_ROWS, 2 * width)
    if rows <= 2 * block:
        first = np.linalg.qr(columns)
        return np.asarray(first.Q), np.asarray(first.R)
    padded = np.zeros((-(-rows // block) * block, width))
    padded[:rows] = columns
    parts = np.linalg.qr(padded.reshape(-1, block, width))
    upper, triangle = thin_qr(np.asarray(parts.R).reshape(-1, width))
    q = parts.Q @ upper.reshape(-1, width, width)
    return np.asarray(q.reshape(-1, width)[:rows]), triangle


def project(columns: Array, data: Array) -> Array:
    """Return X'y for columns X (n, k) and data y (n,), by one core."""
    return np.asarray(np.einsum("ij,i->j", columns, data))


def solve_square(matrix: Array, data: Array) -> Array:
    """Return the solution of a small square system, data (k,) or (k, m)."""
    return np.asarray(np.linalg.solve(matrix, data), dtype=np.float64)


@dataclass(frozen=True)
class OrthogonalFit:
    """A least-squares solution of X b = y with weights.

    `inverse_normal` is (X'WX)^-1; `residuals` are y - X b, not weighted; `leverage` (n,) is the
    diagonal of the weighted hat matrix; `triangle` is R of the weighted, scaled columns.
    """

    coefficients: Array
    inverse_normal: Array
    residuals: Array
    leverage: Array
    sum_of_squares: float
    triangle: Array

    @property
    def condition(self) -> float:
        """The condition number of the columns scaled to equal length."""
        singular = np.linalg.svd(self.triangle, compute_uv=False)
        return float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")


def solve_by_qr(design: Array, data: Array, root_weight: Array | None = None) -> OrthogonalFit:
    """Solve `design` (n, k) b = `data` (n,) by QR of the columns scaled to unit length.

    `root_weight` (n,) multiplies rows: one over their standard deviation. The columns must be
    independent; n may not be below k.
    """
    rows = design if root_weight is None else design * root_weight[:, None]
    values = data if root_weight is None else data * root_weight
    scale = np.sqrt(np.einsum("ij,ij->j", rows, rows))
    scale = np.where(scale > 0.0, scale, 1.0)
    unit = rows / scale
    q, r = thin_qr(unit)
    scaled = solve_square(r, project(q, values))
    # One step of refinement: what the rounding of the first solution left is solved for again.
    scaled = scaled + solve_square(r, project(q, values - combine(unit, scaled)))
    inverse = solve_square(r, np.eye(len(scale)))
    coefficients = scaled / scale
    residuals = data - combine(design, coefficients)
    weighted = residuals if root_weight is None else residuals * root_weight
    return OrthogonalFit(
        coefficients=coefficients,
        inverse_normal=(inverse @ inverse.T) / np.outer(scale, scale),
        residuals=residuals,
        leverage=np.einsum("ij,ij->i", q, q),
        sum_of_squares=float(weighted @ weighted),
        triangle=r,
    )


@dataclass(frozen=True)
class ColumnSplit:
    """Which columns are independent of those kept before them, and what the others are made of.

    column j = sum over i of `folds[i, j]` times column `kept[i]`; a kept column folds into itself.
    """

    kept: tuple[int, ...]
    folds: Array


def split_columns(columns: Array, tolerance: float) -> ColumnSplit:
    """Walk the columns (n, k) in order and keep each that is independent of those kept before.

    Dependent is a column whose part orthogonal to the kept ones has an rms below `tolerance`, in
    the column's own unit. Gram-Schmidt, twice for each column, so that it loses no digits.
    """
    rows, count = columns.shape
    basis = np.empty((rows, 0))
    kept: list[int] = []
    for j in range(count):
        left = orthogonal_part(basis, columns[:, j])
        if float(np.sqrt(np.mean(left**2))) >= tolerance:
            basis = np.column_stack((basis, left / np.linalg.norm(left)))
            kept.append(j)
    folds = np.zeros((len(kept), count))
    if kept:
        shares = np.column_stack([project(basis, columns[:, j]) for j in range(count)])
        folds = solve_square(np.triu(shares[:, kept]), shares)
        folds[:, kept] = np.eye(len(kept))
    return ColumnSplit(tuple(kept), folds)


def orthogonal_part(basis: Array, column: Array) -> Array:
    """Return what of a column (n,) is orthogonal to an orthonormal basis (n, k)."""
    for _ in range(2):
        column = column - combine(basis, project(basis, column))
    return column


def independent_of(columns: Array, candidates: Array, part: float) -> tuple[int, ...]:
    """Return which candidates (n, m), in order, keep more than `part` of their rms.

    Each is held against `columns` (n, k) and the candidates taken before it.
    """
    basis = thin_qr(columns)[0] if columns.shape[1] else np.empty((len(candidates), 0))
    taken: list[int] = []
    for j in range(candidates.shape[1]):
        size = float(np.linalg.norm(candidates[:, j]))
        left = orthogonal_part(basis, candidates[:, j])
        if size > 0.0 and float(np.linalg.norm(left)) > part * size:
            basis = np.column_stack((basis, left / np.linalg.norm(left)))
            taken.append(j)
    return tuple(taken)


def least_absolute(design: Array, data: Array, rounds: int = 12) -> Array:
    """Return residuals (n,) of a fit that takes magnitudes, not squares: hardly moved by outliers.

    Least squares again and again, each row weighted by one over the root of its last residual.
    """
    q = thin_qr(design)[0]
    residuals = data - combine(q, project(q, data))
    for _ in range(rounds):
        size = np.abs(residuals)
        floor = max(1e-3 * float(np.median(size)), 1e-12 * float(np.max(np.abs(data)) or 1.0))
        weight = 1.0 / np.sqrt(np.maximum(size, floor))
        # Columns that are orthonormal without the weights are near enough to it with them.
        weighted = q * weight[:, None]
        normal = cross_products(weighted)
        coefficients = solve_square(normal, project(weighted, data * weight))
        residuals = data - combine(q, coefficients)
    return residuals


def keep_inliers(
    design: Array, data: Array, threshold: float, root_weight: Array | None = None, rounds: int = 20
) -> Mask:
    """Return which rows lie within `threshold` robust standard deviations of the fit.

    Begins at the least absolute residuals, which a few wild rows do not bend; then fits by least
    squares and judges every row by its residual over what its leverage leaves of the noise, until
    nothing changes. A row comes back when the better fit explains it. Rows that carry a column all
    alone are never judged. Stops rather than leave fewer rows than the columns need.
    """
    rows, columns = design.shape
    weight = np.ones(rows) if root_weight is None else root_weight
    kept = np.ones(rows, dtype=bool)
    if rows <= columns + 3:
        return kept
    size = np.abs(least_absolute(design * weight[:, None], data * weight))
    # A least-absolute fit goes exactly through as many rows as it has columns.
    sigma = MAD_TO_SIGMA * float(np.median(np.sort(size)[columns:]))
    fresh = size <= 2.0 * threshold * sigma if sigma > 0.0 else kept
    for turn in range(rounds):
        settled = turn > 0 and bool(np.array_equal(fresh, kept))
        if settled or not _carried(design, fresh):
            break
        kept = fresh
        fit = solve_by_qr(design[kept], data[kept], weight[kept])
        residuals = (data - combine(design, fit.coefficients)) * weight
        scaled = design * weight[:, None]
        spread = np.einsum("ij,ij->i", scaled @ fit.inverse_normal, scaled)
        expected = np.sqrt(np.where(kept, np.maximum(1.0 - spread, 1e-12), 1.0 + spread))
        alone = kept & (spread > 1.0 - 1e-6)
        relative = np.where(alone, 0.0, residuals / expected)
        sigma = MAD_TO_SIGMA * float(np.median(np.abs(relative[kept & ~alone])))
        if sigma <= 0.0:
            break
        fresh = np.abs(relative) <= threshold * sigma
    return kept


def _carried(design: Array, kept: Mask) -> bool:
    """Whether the kept rows still tell all columns apart, with rows to spare."""
    columns = design.shape[1]
    if int(kept.sum()) < columns + 3:
        return False
    sizes = np.linalg.norm(design, axis=0)
    triangle = thin_qr(design[kept] / np.where(sizes > 0, sizes, 1.0))[1]
    singular = np.linalg.svd(triangle, compute_uv=False)
    return bool(singular[-1] > 1e-7 * singular[0])


def choose_by_information(
    sums_of_squares: Sequence[float], columns: Sequence[int], rows: int, charge: float = CHARGE
) -> int:
    """Return the index of the model with the best information criterion, the first of equal ones.

    0 where no model leaves degrees of freedom.
    """
    best, best_value = 0, np.inf
    for index, value in enumerate(information(sums_of_squares, columns, rows, charge)):
        if value < best_value - 1e-9:
            best, best_value = index, value
    return best


def information(
    sums_of_squares: Sequence[float], columns: Sequence[int], rows: int, charge: float = CHARGE
) -> list[float]:
    """Return the information criterion of each model, infinite without degrees of freedom.

    The Bayesian criterion, rows ln(SS / rows) + columns ln(rows), its charge per column raised by
    `charge` and by rows over the degrees of freedom left, so that few rows are not explained by
    many columns.
    """
    smallest = np.finfo(np.float64).tiny
    values = []
    for square, count in zip(sums_of_squares, columns, strict=True):
        free = rows - count - 2
        value = np.inf
        if free >= 1:
            value = rows * np.log(max(square, smallest) / rows)
            value += charge * (count - min(columns)) * np.log(rows) * rows / free
        values.append(float(value))
    return values
