"""What a solution leaves, group by group: shapes without a name, and noise that is not even."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from procedures.estimation.orthogonal import MAD_TO_SIGMA

from .dataset import AccelerometerDataset
from .rows import Rows
from .solved import Misfit, Solution, Solved, Uneven

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RARE = 1e-6
FEWEST_LEFT = 6
MOST_GROUPS = 500
FEWEST_OF_A_GROUP = 20
UNEVEN_SIGMAS = 5.0
PARTS = 3
MAD_VARIANCE = 1.36
"""Times one over the rows: the variance of the logarithm of a median deviation."""


def groups_of(dataset: AccelerometerDataset, usable: Mask) -> Mapping[str, NDArray[np.str_]]:
    """Return the names of the groups that each usable row (n,) is in, by what they share."""
    plane = dataset.plane[usable].astype(str)
    angle = [
        f"{name} at {deg:.5g} deg"
        for name, deg in zip(plane, dataset.theta_commanded_deg[usable], strict=True)
    ]
    field_T = dataset.field_commanded_T[usable]
    field = [f"{name} at {one:.4g} T" for name, one in zip(plane, field_T, strict=True)]
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
        if len(labels) > min(MOST_GROUPS, len(left) // 2):
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


def with_misfit(solved: Solved, groups: Mapping[str, NDArray[np.str_]]) -> Solution:
    """Return the solution with its misfit, which its uncertainties hold."""
    solution, found = solved.solution, misfit(solved, groups)
    if found is None:
        return solution
    covariance = solution.covariance * max(found.ratio, 1.0)
    return replace(solution, covariance=covariance, misfit=found)


def uneven(rows: Rows, solution: Solution) -> Uneven | None:
    """Return by what the noise differs, None where it does not.

    Median deviations of all rows, planes against each other and thirds of
    the record; groups of fewer than twenty rows say too little.
    """
    third = np.arange(len(rows.time_s)) * PARTS // len(rows.time_s)
    found: Uneven | None = None
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
            most, found = float(sigmas), Uneven(what, group.astype(np.int64), noise_V)
    return found
