"""Coil factors, angles and residual field from the frequencies of all shots.

With v_i = a_i B_i for the commanded fields B_i, C the Gram matrix of the coil axes (its elements
the cosines of their angles) and r_i the residual field's projections on them, in rad/s,

    w² = v'C v + 2 v'r + r'C^-1 r.

Solved by weighted Gauss-Newton for as many of the nine unknowns as the shots determine. Over the
four polarities of a pair the terms in r cancel, which is the closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from procedures.estimation.descent import Place, descend, inverse_of
from procedures.estimation.orthogonal import ColumnSplit, split_columns

from .shots import AXES, PAIRS

Array = NDArray[np.float64]

NAMES = (*AXES, *PAIRS, "rx", "ry", "rz")
COUNT = len(NAMES)
PLACES = {"xy": [0, 1], "xz": [0, 2], "yz": [1, 2]}
INDEPENDENT = 1e-3
"""Part of a scaled column, orthogonal to those before it, that makes it one of its own."""
SHARED = 1e-6
"""Of a column, in one that is dropped: from there on the two share their coefficients."""
MAX_STEPS, ENOUGH = 60, 1e-12
SETTLED = 1e-6
"""In natural units: a step that is still to go where the solution has settled."""
IMPROBABLE, DOUBTFUL = 1e-4, 0.05
"""Below the first probability something is wrong; below the second u is enlarged already."""


@dataclass(frozen=True)
class Solution:
    """The nine unknowns: a (3,) in rad/s/nT, cosines (3,) of xy, xz, yz, r (3,) in rad/s.

    `covariance` (9, 9) is that of the noise of the frequencies, enlarged by chi-square over its
    degrees of freedom where that is doubtful (`enlarged`); rows of what is not free are zero.
    `determined` (9,) says which of them the shots determine, cosines and a given that residual
    fields which are not determined are zero. `by_field` (9, 3) are the derivatives by relative
    errors of the commanded fields of x, y, z; `by_residual` (9, 3) those by a residual field (as r)
    that is there but taken for zero; `gain` (9, shots) those by the frequencies. `free_of_residual`
    tells whether the residual field was solved for.
    """

    scale: Array
    cosine: Array
    residual: Array
    covariance: Array
    determined: tuple[bool, ...]
    free_of_residual: bool
    by_field: Array
    by_residual: Array
    gain: Array
    misfit_rad_per_s: Array
    chi_square: float
    degrees_of_freedom: int
    enlarged: bool
    converged: bool

    @property
    def unknowns(self) -> Array:
        """All nine."""
        return np.concatenate([self.scale, self.cosine, self.residual])

    @property
    def sound(self) -> bool:
        """Whether it is settled, and three axes with these angles exist."""
        return self.converged and self.positive_definite

    @property
    def gram(self) -> Array:
        """The Gram matrix of the coil axes."""
        return gram_of(self.cosine)

    @property
    def positive_definite(self) -> bool:
        """Whether three axes with these angles between them exist."""
        return bool(np.all(np.isfinite(self.cosine)) and np.linalg.eigvalsh(self.gram)[0] > 0.0)

    @property
    def probability(self) -> float:
        """How probable a chi-square as large as this is where the model holds."""
        freedom = self.degrees_of_freedom
        return float(chdtrc(freedom, self.chi_square)) if freedom > 0 else 1.0

    @property
    def disagree(self) -> bool:
        """Whether the shots contradict one another beyond doubt."""
        return self.probability < IMPROBABLE

    def ratios(self) -> tuple[Array, Array]:
        """Return the factors of coils y and z over that of x, less one, and their covariance."""
        slopes = np.zeros((2, COUNT))
        slopes[:, 0] = -self.scale[1:] / self.scale[0] ** 2
        slopes[[0, 1], [1, 2]] = 1.0 / self.scale[0]
        return self.scale[1:] / self.scale[0] - 1.0, slopes @ self.covariance @ slopes.T


def gram_of(cosine: Array) -> Array:
    """Return the Gram matrix (3, 3) of unit vectors from their cosines xy, xz, yz."""
    xy, xz, yz = (float(value) for value in cosine)
    return np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])


def frequencies(commanded_nT: Array, p: Array) -> Array:
    """Return the frequencies (shots,) in rad/s of nine unknowns."""
    v, gram, r = commanded_nT * p[:3], gram_of(p[3:6]), p[6:]
    square = np.sum((v @ gram) * v, axis=1) + 2.0 * v @ r + r @ np.linalg.solve(gram, r)
    return np.asarray(np.sqrt(np.maximum(square, 1e-300)))


def slopes_of(commanded_nT: Array, p: Array) -> Array:
    """Return the derivatives (shots, 9) of the frequencies."""
    v, gram, r = commanded_nT * p[:3], gram_of(p[3:6]), p[6:]
    omega = frequencies(commanded_nT, p)
    slopes = np.empty((len(v), COUNT))
    field = v @ gram + r
    slopes[:, :3] = commanded_nT * field
    in_line = np.linalg.solve(gram, r)
    for k, pair in enumerate(PAIRS):
        i, j = PLACES[pair]
        slopes[:, 3 + k] = v[:, i] * v[:, j] - in_line[i] * in_line[j]
    slopes[:, 6:] = v + in_line
    return np.asarray(slopes / omega[:, None])


def solve(commanded_nT: Array, omega: Array, covariance: Array, *, known: bool) -> Solution:
    """Solve for what the shots determine; `commanded_nT` (n, 3), `omega` (n,) with covariance.

    `known`: commanded fields are exact, so that all three a are one. Raises ValueError without a
    shot.
    """
    if not len(omega):
        raise ValueError("no shot")
    size = np.linalg.norm(commanded_nT, axis=1)
    a = float(np.median(omega / size))
    start = np.zeros(COUNT)
    start[:3] = a
    natural = np.array([a] * 3 + [1.0] * 3 + [a * float(np.median(size))] * 3)
    # Which unknowns each parameter moves, (9, parameters): one a for all coils, or each its own.
    maps = np.eye(COUNT)
    if known:
        maps = np.column_stack([maps[:, :3].sum(axis=1), maps[:, 3:]])
    kept, determined, free_of_residual = _judge(commanded_nT, start, natural, maps)
    if free_of_residual:
        start = _begin(commanded_nT, omega, start)
        if known:
            start[:3] = float(np.mean(start[:3]))
    mapping = maps[:, kept] * natural[:, None]
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))

    def at(moved: Array) -> Place[Array]:
        p = start + mapping @ moved
        left = omega - frequencies(commanded_nT, p)
        return Place.of((whiten @ slopes_of(commanded_nT, p) @ mapping).T, whiten @ left, p)

    unmoved = np.zeros(len(kept))
    _, place = descend(at, unmoved, MAX_STEPS, ENOUGH) or (unmoved, at(unmoved))
    p, chi_square, inverse = place.what, place.cost, inverse_of(place.normal)
    converged = inverse is not None and bool(np.max(np.abs(inverse @ place.right)) < SETTLED)
    if inverse is None:
        inverse = np.full_like(place.normal, np.nan)
    covered = mapping @ inverse @ mapping.T
    slopes = slopes_of(commanded_nT, p)
    gain = covered @ slopes.T @ whiten.T @ whiten
    freedom = len(omega) - len(kept)
    doubtful = freedom > 0 and float(chdtrc(freedom, chi_square)) < DOUBTFUL
    return Solution(
        scale=p[:3],
        cosine=p[3:6],
        residual=p[6:],
        covariance=covered * (chi_square / freedom if doubtful else 1.0),
        determined=determined,
        free_of_residual=free_of_residual,
        by_field=-gain @ (slopes[:, :3] * p[:3]),
        by_residual=-gain @ slopes[:, 6:] * (not free_of_residual),
        gain=gain,
        misfit_rad_per_s=omega - frequencies(commanded_nT, p),
        chi_square=chi_square,
        degrees_of_freedom=freedom,
        enlarged=doubtful,
        converged=converged,
    )


def _begin(commanded_nT: Array, omega: Array, p: Array) -> Array:
    """Return the nine unknowns that solve w², which is linear in ten combinations of them.

    Right for a residual field of any size; `p` where the shots do not tell the ten apart.
    """
    products = [commanded_nT[:, i] * commanded_nT[:, j] for i, j in PLACES.values()]
    square = [*(commanded_nT.T**2), *(2.0 * np.array(products)), *(2.0 * commanded_nT.T)]
    design = np.column_stack([*square, np.ones(len(omega))])
    scale = np.max(np.abs(design), axis=0)
    if np.any(scale == 0.0) or np.linalg.cond(design / scale) > 1.0 / INDEPENDENT:
        return p
    start = np.linalg.lstsq(design / scale, omega**2, rcond=None)[0] / scale
    if np.any(start[:3] <= 0.0):
        return p
    a = np.sqrt(start[:3])
    cosine = start[3:6] / np.array([a[i] * a[j] for i, j in PLACES.values()])
    if float(np.linalg.eigvalsh(gram_of(cosine))[0]) <= 0.0:
        return p
    return np.concatenate([a, cosine, start[6:9] / a])


def _judge(
    commanded_nT: Array, p: Array, natural: Array, maps: Array
) -> tuple[list[int], tuple[bool, ...], bool]:
    """Return which parameters to solve for, which unknowns are determined, and if r is solved for.

    In the order a, cosines, r a parameter is kept that is independent of those before it.
    """
    slopes = slopes_of(commanded_nT, p) @ (maps * natural[:, None])
    slopes = slopes / float(np.max(np.abs(slopes)))
    residual: NDArray[np.bool_] = np.asarray(np.any(maps[6:] != 0.0, axis=0))
    split = split_columns(slopes, INDEPENDENT)
    free = bool(np.all(_alone(split)[residual]))
    # A residual field that is not wholly determined is taken for zero.
    kept = [k for k in split.kept if free or not residual[k]]
    ok = residual & free
    ok[~residual] = _alone(split_columns(slopes[:, ~residual], INDEPENDENT))
    determined = tuple(bool(ok[np.flatnonzero(maps[n])[0]]) for n in range(COUNT))
    return kept, determined, free


def _alone(split: ColumnSplit) -> NDArray[np.bool_]:
    """Return which columns nothing in the others can stand in for."""
    kept = list(split.kept)
    alone = np.zeros(split.folds.shape[1], dtype=bool)
    alone[kept] = np.max(np.abs(np.delete(split.folds, kept, axis=1)), axis=1, initial=0.0) < SHARED
    return alone
