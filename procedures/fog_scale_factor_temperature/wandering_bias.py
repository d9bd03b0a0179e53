"""A gyro bias that wanders: how much, from the data, and least squares that knows of it.

The bias is a polynomial of temperature and a random walk in time. The walk's size against the
turns' own noise is found by restricted maximum likelihood (Patterson and Thompson, Biometrika 58,
1971): the likelihood of what is orthogonal to all fitted columns. Turns of both senses side by side
then cancel the bias between them however fast it walks, and a turn whose partner is missing still
counts as far as the neighbouring sets tell the bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from procedures.estimation.orthogonal import solve_by_qr

from .dataset import Array, Mask

RATIOS = np.concatenate(([0.0], 10.0 ** np.linspace(-4.0, 7.0, 221)))
"""Sizes of a walk over one set, as a variance in units of a turn's own."""


def walk_kernel(middle_s: Array, duration_s: Array, step_s: float) -> Array:
    """Return the covariance (n, n) of the turns' errors under a walk of variance one per step.

    In units of the mean duration: a bias acts as long as a turn lasts. Begins at the first turn;
    what it was then is left to the fitted columns.
    """
    since = (middle_s - middle_s.min()) / step_s
    weight = duration_s / float(np.mean(duration_s))
    return np.asarray(np.minimum.outer(since, since) * np.outer(weight, weight))


def walk_ratio(design: Array, data: Array, kernel: Array) -> float:
    """Return the variance of the walk over a step, in units of the variance of the white noise.

    By restricted maximum likelihood over `RATIOS`; the columns of `design` (n, k) are taken out.
    """
    rows, columns = design.shape
    if rows - columns < 3:
        return 0.0
    complete = np.linalg.qr(design, mode="complete").Q
    rest = complete[:, columns:]
    sizes, vectors = np.linalg.eigh(rest.T @ kernel @ rest)
    squares = (vectors.T @ (rest.T @ data)) ** 2
    spread = 1.0 + np.outer(RATIOS, np.maximum(sizes, 0.0))
    power = np.maximum((squares / spread).sum(axis=1), np.finfo(np.float64).tiny)
    criterion = (rows - columns) * np.log(power) + np.log(spread).sum(axis=1)
    return float(RATIOS[int(np.argmin(criterion))])


@dataclass(frozen=True)
class CorrelatedFit:
    """A generalised least-squares solution; noise in the unit of the data.

    `inverse_normal` times `noise` squared is the covariance. `white` (n,) is what the solution
    leaves once the walk, too, is taken off: the turns' own errors. What the walk takes of the data
    is no degree of freedom of the noise.
    """

    coefficients: Array
    inverse_normal: Array
    noise: float
    degrees_of_freedom: float
    white: Array


class Walk:
    """Turns whose errors share a walk of the bias; whitens columns and data."""

    def __init__(self, kernel: Array, ratio: float) -> None:
        self.factor = cholesky(np.eye(len(kernel)) + ratio * kernel, lower=True)

    def whiten(self, columns: Array) -> Array:
        """Return columns (n,) or (n, k) whose errors would be independent and of equal size."""
        return np.asarray(solve_triangular(self.factor, columns, lower=True))

    def back(self, whitened: Array) -> Array:
        """Return V^-1 r of whitened residuals r: what is white in them, shape (n,)."""
        return np.asarray(solve_triangular(self.factor, whitened, lower=True, trans="T"))

    def fit(self, design: Array, data: Array) -> CorrelatedFit:
        """Solve `design` (n, k) b = `data` (n,)."""
        solved = solve_by_qr(self.whiten(design), self.whiten(data))
        free = len(data) - design.shape[1]
        noise = float(np.sqrt(solved.sum_of_squares / free)) if free > 0 else 0.0
        white = self.back(solved.residuals)
        own = float((self.whiten(np.eye(len(data))) ** 2).sum()) - design.shape[1]
        return CorrelatedFit(
            solved.coefficients, solved.inverse_normal, noise, max(own, 1.0), white
        )


def deleted_residuals(design: Array, data: Array, kernel: Array, ratio: float, kept: Mask) -> Array:
    """Return how far each row lies from what the other kept rows foretell, shape (n,).

    In units of its standard deviation, the white noise taken for one; columns `design` (n, k), a
    walk by `kernel` (n, n) of size `ratio`.
    """
    walk = Walk(kernel[np.ix_(kept, kept)], ratio)
    columns = walk.whiten(design[kept])
    solved = solve_by_qr(columns, walk.whiten(data[kept]))
    result = np.zeros(len(data))
    # Of a kept row: (P y)_i / sqrt(P_ii), with P the projector that takes the columns out.
    inverse = walk.whiten(np.eye(int(kept.sum())))
    hat = inverse.T @ columns
    own = np.einsum("ji,ji->i", inverse, inverse)
    own = own - np.einsum("ij,jk,ik->i", hat, solved.inverse_normal, hat)
    alone = own < 1e-9
    left = walk.back(solved.residuals)
    result[kept] = np.where(alone, 0.0, left / np.sqrt(np.where(alone, 1.0, own)))
    out = np.flatnonzero(~kept)
    if len(out):
        cross = walk.whiten(ratio * kernel[np.ix_(kept, out)])
        foretold = design[out] @ solved.coefficients + cross.T @ solved.residuals
        gap = design[out] - cross.T @ columns
        variance = 1.0 + ratio * kernel[out, out] - np.einsum("ji,ji->i", cross, cross)
        variance = variance + np.einsum("ij,jk,ik->i", gap, solved.inverse_normal, gap)
        result[out] = (data[out] - foretold) / np.sqrt(variance)
    return result
