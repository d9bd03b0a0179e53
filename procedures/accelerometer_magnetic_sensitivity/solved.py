"""A solution of all rows, what it is compared by, and what it leaves group by group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from procedures.estimation.alternatives import FEWEST_LEFT, Alternative
from procedures.estimation.orthogonal import MAD_TO_SIGMA
from procedures.estimation.slow_terms import Terms

from .dataset import AccelerometerDataset, Rows
from .nuisances import ENCODER_JUMP, JUMP, TurnedModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
RARE = 1e-6
MAX_GROUPS = 500
FEWEST_OF_A_GROUP = 20
UNEVEN_SIGMAS = 5.0
PARTS = 3
MAD_VARIANCE = 1.36
"""Times one over the rows: the variance of the logarithm of a median deviation."""


@dataclass(frozen=True)
class Misfit:
    """Residuals that rows of a group share: groups by `what`, the largest, its mean.

    `ratio` is how many times as large as by chance the squares of what is shared are.
    """

    what: str
    largest: str
    size_V: float
    ratio: float


@dataclass(frozen=True)
class Uneven:
    """Noise that differs by `what`: the group of each row (rows,) and the noise of each group."""

    what: str
    group: NDArray[np.int64]
    noise_V: Array


@dataclass(frozen=True)
class Solution:
    """Coefficients of the kept columns first, then nuisance terms, `names` in that order.

    Offset and jump of the encoder are in arcsec; `cause` is what else moved the output, `jump_rad`
    what is added to the encoder where it is off. `kept` (rows,) are the rows that count;
    `covariance` holds the scale of the noise. `shares` (names, 13) are what the solution takes of
    each column of the model, `folded` what the coefficients (k,) take of each alignment term that
    is not fitted. `drift_order` is that of the polynomial in time that the rows ask for, 0 where
    they ask for none, and `sum_of_squares` the weighted squares that it left, in V².
    """

    names: tuple[str, ...]
    coefficients: Array
    covariance: Array
    kept: Mask
    residual_V: Array
    degrees_of_freedom: int
    noise_V: float
    condition: float
    not_separable: tuple[str, ...]
    folded: Mapping[str, Array]
    cause: Alternative | None
    jump_rad: float
    shares: Array
    drift_order: int
    sum_of_squares: float
    misfit: Misfit | None = None
    uneven: Uneven | None = None

    @property
    def values(self) -> dict[str, float]:
        """The coefficients and terms by their names."""
        return dict(zip(self.names, self.coefficients.tolist(), strict=True))

    @property
    def price(self) -> int:
        """For how many columns it counts: each row left out is one that it explains."""
        place = 0
        if self.cause is not None:
            folds = self.cause.code == ENCODER_JUMP and JUMP not in self.names
            place = self.cause.places + folds
        return len(self.names) + place + int(np.sum(~self.kept))

    @property
    def lag_one_correlation(self) -> float:
        """The correlation of neighbouring residuals of the rows that count."""
        left = self.residual_V[self.kept]
        square = float(left @ left)
        return float(left[1:] @ left[:-1]) / square if square > 0.0 else 0.0


@dataclass(frozen=True)
class Solved:
    """A solution, its design (rows, k) and the output's derivative by the angle.

    `slow` are the last columns of the design: temperature and drift. `acceleration_g` (rows, 3) is
    at the solved angle, `model` holds the columns at it. `terms` are all slow terms, `usable` those
    that the rows tell from the others; `root_weight` (rows,) is one over the noise.
    """

    solution: Solution
    design: Array
    slope: Array
    slow: Array
    acceleration_g: Array
    model: TurnedModel
    terms: Terms
    usable: Terms
    root_weight: Array


def groups_of(dataset: AccelerometerDataset, usable: Mask) -> Mapping[str, NDArray[np.str_]]:
    """Return the names of the groups that each usable row (n,) is in, by what they share."""
    plane = dataset.plane[usable].astype(str)
    angle = [
        f"{name} at {deg:.5g} deg"
        for name, deg in zip(plane, dataset.theta_commanded_deg[usable], strict=True)
    ]
    field_T = dataset.field_commanded_T[usable]
    field = [f"{name} at {level_T:.4g} T" for name, level_T in zip(plane, field_T, strict=True)]
    return {"angle": np.array(angle), "field": np.array(field)}


def misfit(solved: Solved, groups: Mapping[str, NDArray[np.str_]]) -> Misfit | None:
    """Return what groups of kept rows share beyond noise, None where nothing does.

    An analysis of variance: the part of the residuals that is common to the rows of a group and
    not in the span of the design, against the part that is not.
    """
    kept, design = solved.solution.kept, solved.design
    left = solved.solution.residual_V[kept]
    q = np.linalg.qr(design[kept]).Q
    worst: Misfit | None = None
    for what, names in groups.items():
        labels, number = np.unique(names[kept], return_inverse=True)
        if len(labels) > min(MAX_GROUPS, len(left) // 2):
            continue
        member = np.eye(len(labels))[number]
        own = member - q @ (q.T @ member)
        basis, size, _ = np.linalg.svd(own, full_matrices=False)
        basis = basis[:, size > 1e-3]
        between, free = basis.shape[1], len(left) - design.shape[1] - basis.shape[1]
        if not between or free < FEWEST_LEFT:
            continue
        shared = float(np.sum((basis.T @ left) ** 2))
        rest = max(float(left @ left) - shared, 1e-300) / free
        ratio = shared / between / rest
        if float(fdtrc(between, free, ratio)) < RARE and (worst is None or ratio > worst.ratio):
            mean = np.bincount(number, left) / np.bincount(number)
            place = int(np.argmax(np.abs(mean)))
            worst = Misfit(what, str(labels[place]), float(mean[place]), ratio)
    return worst


def with_misfit(solution: Solution) -> Solution:
    """Return the solution with uncertainties that hold its misfit."""
    worst = solution.misfit
    if worst is None:
        return solution
    return replace(solution, covariance=solution.covariance * max(worst.ratio, 1.0))


def uneven(rows: Rows, solution: Solution) -> Uneven | None:
    """Return by what the noise differs, None where it does not.

    Median deviations of all rows, planes against each other and thirds of
    the record; groups of fewer than twenty rows say too little.
    """
    third = np.arange(len(rows.time_s)) * PARTS // len(rows.time_s)
    worst: Uneven | None = None
    most = UNEVEN_SIGMAS
    for what, names in (("plane", rows.plane), ("time", third)):
        _, group = np.unique(names, return_inverse=True)
        count = np.bincount(group)
        if len(count) < 2 or int(count.min()) < FEWEST_OF_A_GROUP:
            continue
        size = np.abs(solution.residual_V)
        noise_V = MAD_TO_SIGMA * np.array([np.median(size[group == n]) for n in range(len(count))])
        low, high = int(np.argmin(noise_V)), int(np.argmax(noise_V))
        if noise_V[low] <= 0.0:
            continue
        sigmas = np.log(noise_V[high] / noise_V[low]) / np.sqrt(
            MAD_VARIANCE * (1.0 / count[low] + 1.0 / count[high])
        )
        if sigmas > most:
            most, worst = float(sigmas), Uneven(what, group.astype(np.int64), noise_V)
    return worst
