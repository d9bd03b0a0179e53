"""Restricted maximum likelihood of variance components that are not below zero.

The data are independent normal numbers whose variances are sums of known parts, theta_j P_j + a
known rest, about columns of unknown size. Each scoring step is a weighted fit of the squared
residuals, the leverage of the columns added, by the parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import nnls

Array = NDArray[np.float64]

MAX_STEPS = 60
CLOSE = 1e-4
"""Standard uncertainties by which a step may still move a component when the search ends."""

SMALLEST = 1e-30
"""Of a variance: data that do not move at all have this, and no quotient of it is without end."""
RIDGE = 1e-13
"""Of a scaled normal matrix: far below what the numbers hold, and enough that it has an inverse."""


@dataclass(frozen=True)
class Stretch:
    """One record: data (m,), parts of the variance (j, m), the known rest (m,), columns (m, p)."""

    data: Array
    parts: Array
    rest: Array
    columns: Array

    def variance(self, theta: Array) -> Array:
        """Return the variances (m,) of the data."""
        return np.maximum(theta @ self.parts + self.rest, SMALLEST)


@dataclass(frozen=True)
class Solved:
    """Columns fitted to one record: sizes, their covariance, residuals and leverages (m,)."""

    sizes: Array
    covariance: Array
    residuals: Array
    leverage: Array
    variance: Array

    @property
    def deviance(self) -> float:
        """-2 ln of the likelihood without a constant."""
        return float(np.sum(np.log(self.variance) + self.residuals**2 / self.variance))

    @property
    def restricted_deviance(self) -> float:
        """-2 ln of the restricted likelihood without a constant."""
        return self.deviance - float(np.linalg.slogdet(self.covariance)[1])


@dataclass(frozen=True)
class Components:
    """The components theta (j,), their covariance (j, j), and each record's columns."""

    theta: Array
    covariance: Array
    solved: tuple[Solved, ...]

    @property
    def u(self) -> Array:
        """The standard uncertainties (j,) of the components, also of those at zero."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def deviance(self) -> float:
        """-2 ln of the likelihood without a constant, of all records."""
        return sum(record.deviance for record in self.solved)

    @property
    def restricted_deviance(self) -> float:
        """-2 ln of the restricted likelihood without a constant, of all records."""
        return sum(record.restricted_deviance for record in self.solved)


def solve(stretch: Stretch, variance: Array) -> Solved:
    """Return the columns of a record fitted with known variances."""
    weighted = stretch.columns / variance[:, None]
    covariance = _inverse(stretch.columns.T @ weighted)
    sizes: Array = covariance @ (weighted.T @ stretch.data)
    residuals = stretch.data - stretch.columns @ sizes
    leverage = np.einsum("ij,ij->i", stretch.columns @ covariance, stretch.columns)
    return Solved(sizes, covariance, residuals, leverage, variance)


def _inverse(normal: Array) -> Array:
    """Return the inverse of a normal matrix (p, p); columns that repeat others share their size."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), SMALLEST))
    scaled = normal * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += RIDGE
    return np.asarray(np.linalg.inv(scaled) * np.outer(scale, scale), dtype=np.float64)


def fit(
    stretches: Sequence[Stretch], start: Array | None = None, held: tuple[int, float] | None = None
) -> Components:
    """Return the components of records that share them.

    `start` (j,) is where the search begins; `held` fixes one component, number and value.
    """
    theta = _first(stretches) if start is None else start.copy()
    if held is not None:
        theta[held[0]] = held[1]
    now = components_at(stretches, theta)
    for _ in range(MAX_STEPS):
        aim = _step(stretches, now, held)
        length = 1.0
        while True:
            then = components_at(stretches, now.theta + length * (aim - now.theta))
            if then.restricted_deviance <= now.restricted_deviance + 1e-9 or length < 1e-3:
                break
            length /= 2.0
        moved = np.abs(then.theta - now.theta)
        if then.restricted_deviance <= now.restricted_deviance:
            now = then
        if bool(np.all(moved <= CLOSE * now.u)) or length < 1e-3:
            break
    return now


def profile_interval(
    stretches: Sequence[Stretch], best: Components, number: int, coverage_factor: float = 1.96
) -> tuple[float, float]:
    """Return the interval of one component that the profile of the likelihood gives."""
    most = best.restricted_deviance + coverage_factor**2
    top, u = float(best.theta[number]), float(best.u[number])

    def beyond(value: float) -> bool:
        held = fit(stretches, best.theta, (number, value))
        return held.restricted_deviance > most

    reach = 2.0 * u
    while not beyond(top + reach) and reach < 1e3 * u:
        reach *= 2.0
    upper = _edge(beyond, top, top + reach)
    lower = _edge(beyond, top, 0.0) if top > 0.0 and beyond(0.0) else 0.0
    return lower, upper


def _edge(beyond: object, inside: float, outside: float) -> float:
    """Return where `beyond` begins, to a hundredth of the way."""
    assert callable(beyond)
    for _ in range(8):
        middle = 0.5 * (inside + outside)
        if beyond(middle):
            outside = middle
        else:
            inside = middle
    return 0.5 * (inside + outside)


def components_at(stretches: Sequence[Stretch], theta: Array) -> Components:
    """Return records and uncertainties with given components (j,)."""
    solved = tuple(solve(stretch, stretch.variance(theta)) for stretch in stretches)
    count = len(theta)
    information = np.zeros((count, count))
    for stretch, record in zip(stretches, solved, strict=True):
        shares = stretch.parts / record.variance
        # tr(P_i M P_j M) with M = W - W X (X'WX)^-1 X'W: the columns' share is taken off.
        information += 0.5 * (shares * (1.0 - 2.0 * record.leverage / record.variance)) @ shares.T
        cross = np.array(
            [(stretch.columns.T * (part / record.variance)) @ stretch.columns for part in shares]
        )
        taken = record.covariance @ cross
        information += 0.5 * np.einsum("iab,jba->ij", taken, taken)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    covariance = np.linalg.pinv(information * np.outer(scale, scale), hermitian=True)
    return Components(theta, covariance * np.outer(scale, scale), solved)


def _step(stretches: Sequence[Stretch], now: Components, held: tuple[int, float] | None) -> Array:
    """Return where one scoring step leads."""
    count = len(now.theta)
    normal, right = np.zeros((count, count)), np.zeros(count)
    for stretch, record in zip(stretches, now.solved, strict=True):
        squares = record.residuals**2 + record.leverage - stretch.rest
        weighted = stretch.parts / record.variance**2
        normal += weighted @ stretch.parts.T
        right += weighted @ squares
    return _not_below_zero(normal, right, held)


def _not_below_zero(normal: Array, right: Array, held: tuple[int, float] | None) -> Array:
    free = np.array([n for n in range(len(right)) if held is None or n != held[0]])
    theta = np.zeros(len(right))
    if held is not None:
        theta[held[0]] = held[1]
        right = right - normal[:, held[0]] * held[1]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal)[free], SMALLEST))
    scaled = normal[np.ix_(free, free)] * np.outer(scale, scale)
    root = cholesky(scaled + 1e-12 * np.eye(len(free)), lower=True)
    scaled_theta, _ = nnls(root.T, solve_triangular(root, right[free] * scale, lower=True))
    theta[free] = scaled_theta * scale
    return theta


def _first(stretches: Sequence[Stretch]) -> Array:
    """Return a first estimate: squares weighted by what they are in their neighbourhood."""
    count = len(stretches[0].parts)
    normal, right = np.zeros((count, count)), np.zeros(count)
    for stretch in stretches:
        flat = np.full(len(stretch.data), max(float(np.mean(stretch.data**2)), SMALLEST))
        squares = solve(stretch, flat).residuals ** 2
        edges = np.unique(np.rint(np.geomspace(1, len(squares) + 1, 30)).astype(int)) - 1
        sums = np.add.reduceat(squares, edges[:-1]) / np.diff(edges)
        near = np.repeat(np.maximum(sums, 1e-12 * flat[0]), np.diff(edges))
        weighted = stretch.parts / near**2
        normal += weighted @ stretch.parts.T
        right += weighted @ (squares - stretch.rest)
    theta = _not_below_zero(normal, right, None)
    if not theta.any():
        theta[min(1, count - 1)] = 1e-12
    return theta
