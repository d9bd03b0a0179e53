"""A gyro bias that wanders: how much, from the data, and least squares that knows of it.

The bias is a polynomial of temperature and a random walk in time. The walk's size against the
turns' own noise is found by restricted maximum likelihood (Patterson and Thompson, Biometrika 58,
1971): the likelihood of what is orthogonal to all fitted columns. Turns of both senses side by side
then cancel the bias between them however fast it walks, and a turn whose partner is missing still
counts as far as the neighbouring sets tell the bias.

Whitening is the innovations of a Kalman filter for the walk, one turn after the other. Products go
by one core: matrices of a hundred rows only make a threaded library wait.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import project, solve_by_qr

from .dataset import Array, Mask

COARSE = np.concatenate(([0.0], 10.0 ** np.linspace(-4.0, 7.0, 45)))
"""Sizes of a walk over one set, as a variance in units of a turn's own."""
FINE = 10.0 ** np.linspace(-0.25, 0.25, 11)


@dataclass(frozen=True)
class Course:
    """When the bias acts, rows in the order of time: steps since the first turn, and how long.

    `since` (n,) is in steps of the walk, `weight` (n,) the duration in units of the mean.
    """

    since: Array
    weight: Array

    def of(self, rows: Mask) -> Course:
        """Return the course at some of the rows."""
        return Course(self.since[rows], self.weight[rows])

    def covariance(self, rows: Mask, others: Mask) -> Array:
        """Return the covariance of rows and others under a walk of variance one per step."""
        shared = np.minimum.outer(self.since[rows], self.since[others])
        return np.asarray(shared * np.outer(self.weight[rows], self.weight[others]))


def course_of(middle_s: Array, duration_s: Array, step_s: float) -> Course:
    """Return the course of turns; what the bias was at the first is left to the columns."""
    return Course((middle_s - middle_s.min()) / step_s, duration_s / float(np.mean(duration_s)))


def innovations(course: Course, ratios: Array, columns: Array) -> tuple[Array, Array]:
    """Return columns (n, k) whitened for each of m ratios, (m, n, k), and their variances (m, n).

    A column that is the turns' errors comes out as independent values of variance one.
    """
    rows, width = columns.shape
    state = np.zeros((len(ratios), width))
    spread = np.zeros(len(ratios))
    white = np.empty((len(ratios), rows, width))
    variance = np.empty((len(ratios), rows))
    steps = np.maximum(np.diff(course.since, prepend=0.0), 0.0)
    for n in range(rows):
        weight = course.weight[n]
        spread = spread + ratios * steps[n]
        variance[:, n] = 1.0 + weight**2 * spread
        new = columns[n] - weight * state
        gain = weight * spread / variance[:, n]
        state = state + gain[:, None] * new
        spread = spread / variance[:, n]
        white[:, n] = new / np.sqrt(variance[:, n])[:, None]
    return white, variance


def walk_ratio(design: Array, data: Array, course: Course) -> float:
    """Return the variance of the walk over a step, in units of the variance of the white noise.

    By restricted maximum likelihood; the columns of `design` (n, k) are taken out.
    """
    rows, width = design.shape
    if rows - width < 3:
        return 0.0
    # What the columns take of the data does not matter, and would cost digits.
    left = solve_by_qr(design, data).residuals
    size = float(np.sqrt(left @ left))
    if size <= 1e-12 * float(np.sqrt(data @ data)):
        return 0.0
    scale = np.sqrt(np.einsum("ij,ij->j", design, design))
    columns = np.column_stack((design / np.where(scale > 0.0, scale, 1.0), left / size))
    best = _likeliest(columns, course, COARSE)
    return best if best == 0.0 else _likeliest(columns, course, best * FINE)


def _likeliest(columns: Array, course: Course, ratios: Array) -> float:
    rows, width = columns.shape
    white, variance = innovations(course, ratios, columns)
    normal = np.swapaxes(white, 1, 2) @ white
    normal += 1e-13 * np.eye(width) * np.trace(normal, axis1=1, axis2=2)[:, None, None]
    diagonal = np.diagonal(np.linalg.cholesky(normal), axis1=1, axis2=2)
    criterion = 2.0 * (rows - width + 1) * np.log(diagonal[:, -1])
    criterion += 2.0 * np.log(diagonal[:, :-1]).sum(axis=1) + np.log(variance).sum(axis=1)
    return float(ratios[int(np.argmin(criterion))])


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
    """Turns whose errors share a walk of the bias: V = 1 + ratio x covariance of the walk."""

    def __init__(self, course: Course, ratio: float) -> None:
        identity = np.eye(len(course.since))
        white, variance = innovations(course, np.array([ratio]), identity)
        self.factor = white[0]
        """Lower triangle that makes independent errors of equal size: its square is V^-1."""
        self.log_determinant = float(np.log(variance).sum())

    def whiten(self, columns: Array) -> Array:
        """Return columns (n, k) whose errors would be independent and of equal size."""
        return np.asarray(np.einsum("ij,jk->ik", self.factor, columns))

    def fit(self, design: Array, data: Array) -> CorrelatedFit:
        """Solve `design` (n, k) b = `data` (n,)."""
        solved = solve_by_qr(self.whiten(design), combine(self.factor, data))
        free = len(data) - design.shape[1]
        noise = float(np.sqrt(solved.sum_of_squares / free)) if free > 0 else 0.0
        own = float((self.factor**2).sum()) - design.shape[1]
        return CorrelatedFit(
            solved.coefficients,
            solved.inverse_normal,
            noise,
            max(own, 1.0),
            project(self.factor, solved.residuals),
        )


def deleted_residuals(
    design: Array, data: Array, course: Course, ratio: float, kept: Mask
) -> Array:
    """Return how far each row lies from what the other kept rows foretell, shape (n,).

    In units of its standard deviation, the white noise taken for one; columns `design` (n, k), a
    walk of size `ratio`.
    """
    walk = Walk(course.of(kept), ratio)
    columns = walk.whiten(design[kept])
    solved = solve_by_qr(columns, combine(walk.factor, data[kept]))
    result = np.zeros(len(data))
    # Of a kept row: (P y)_i / sqrt(P_ii), with P the projector that takes the columns out.
    hat = np.einsum("ji,jk->ik", walk.factor, columns)
    own = np.einsum("ji,ji->i", walk.factor, walk.factor)
    own = own - np.einsum("ij,ij->i", combine_all(hat, solved.inverse_normal), hat)
    alone = own < 1e-9
    left = project(walk.factor, solved.residuals)
    result[kept] = np.where(alone, 0.0, left / np.sqrt(np.where(alone, 1.0, own)))
    out = ~kept
    if bool(out.any()):
        shared = walk.whiten(ratio * course.covariance(kept, out))
        foretold = combine(design[out], solved.coefficients) + project(shared, solved.residuals)
        gap = design[out] - np.einsum("ji,jk->ik", shared, columns)
        variance = 1.0 + ratio * course.since[out] * course.weight[out] ** 2
        variance = variance - np.einsum("ji,ji->i", shared, shared)
        variance = variance + np.einsum("ij,ij->i", combine_all(gap, solved.inverse_normal), gap)
        result[out] = (data[out] - foretold) / np.sqrt(variance)
    return result


def combine_all(columns: Array, matrix: Array) -> Array:
    """Return X M for columns X (n, k) and a small matrix M (k, m), by one core."""
    return np.asarray(np.einsum("ij,jk->ik", columns, matrix))
