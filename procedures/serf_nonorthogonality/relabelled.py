"""Which other statement of the commanded fields lets shots agree that contradict one another.

Frequencies do not tell a coil that is reversed in one pair from one that is reversed in all others:
both are named. A coil that is reversed in all shots changes no chi-square and is not seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from station.findings import Flag, contradiction

from .angles import DOUBTFUL, solve
from .dataset import Frequencies, SerfDataset
from .precession import Precession
from .shots import AXES

Array = NDArray[np.float64]
MAX_NAMED = 4
"""Where more statements than these suit the shots, the shots tell none of them from the others."""
MIN_FREEDOM = 2
BY_CHANCE = 0.05
"""So seldom one of the statements of a kind may suit shots that disagree for another cause."""


@dataclass(frozen=True)
class Relabelled:
    """Commanded fields (shots, 3) in nT that may have been meant, and how they differ."""

    what: str
    shots: NDArray[np.int64]
    commanded_nT: Array


def relabelled_flags(
    dataset: SerfDataset, seen: Sequence[Precession], frequencies: Frequencies | None
) -> Iterator[Flag]:
    """Yield a flag that names what was probably commanded, where shots disagree as stated."""
    if frequencies is None or not frequencies.solution.disagree:
        return
    used = [precession for precession in seen if precession.used]
    commanded_nT = np.array([precession.shot.field_nT for precession in used])
    names = [precession.shot.name for precession in used]
    suits: list[tuple[Relabelled, float]] = []
    for kind in (reversals(commanded_nT), pairs_mistaken(commanded_nT), swaps(commanded_nT, names)):
        suits += _agreeing(list(kind), frequencies, known=dataset.constants_known)
    if not 0 < len(suits) <= MAX_NAMED:
        return
    what = ", or if ".join(suit.what for suit, _ in suits)
    concerned = sorted({names[k] for suit, _ in suits for k in suit.shots})
    least = min(chi_square for _, chi_square in suits)
    yield contradiction(
        "shots",
        f"Chi-square of the shots falls from {frequencies.solution.chi_square:.1f} to {least:.1f} "
        f"if {what}. Correct the commanded fields of these shots, or their names; the angles hold "
        "that error.",
        shots=concerned,
    )


def reversals(commanded_nT: Array) -> Iterator[Relabelled]:
    """Yield the statements in which a coil, or both, were reversed in the shots of a pair."""
    groups = _groups(commanded_nT)
    for coils, rows in groups.items():
        for turned in dict.fromkeys((*coils, coils)) if len(groups) > 1 else ():
            meant = commanded_nT.copy()
            for axis in turned:
                meant[rows, AXES.index(axis)] *= -1.0
            were = f"coil {turned} was" if len(turned) == 1 else f"coils {turned} were"
            yield Relabelled(f"{were} reversed in the shots of {coils}", rows, meant)


def pairs_mistaken(commanded_nT: Array) -> Iterator[Relabelled]:
    """Yield the statements in which the shots of a pair were taken with other coils."""
    for (coils, rows), (other, others) in permutations(_groups(commanded_nT).items(), 2):
        partner = _partners(commanded_nT[rows], commanded_nT[others])
        if partner is None:
            continue
        meant = commanded_nT.copy()
        meant[rows] = commanded_nT[others[partner]]
        yield Relabelled(f"the shots of {coils} were taken with the coils {other}", rows, meant)
        if coils < other:
            meant = meant.copy()
            meant[others[partner]] = commanded_nT[rows]
            what = f"the shots of {coils} and of {other} stand under each other's names"
            yield Relabelled(what, np.concatenate([rows, others]), meant)


def swaps(commanded_nT: Array, names: Sequence[str]) -> Iterator[Relabelled]:
    """Yield the statements in which two shots stand under each other's names."""
    for a, b in combinations(range(len(names)), 2):
        meant = commanded_nT.copy()
        meant[[a, b]] = commanded_nT[[b, a]]
        what = f"{names[a]} and {names[b]} stand under each other's names"
        yield Relabelled(what, np.array([a, b]), meant)


def _groups(commanded_nT: Array) -> Mapping[str, NDArray[np.int64]]:
    """Return the rows of the shots that drive the same coils."""
    coils = np.array(["".join(np.array(AXES)[row != 0.0]) for row in commanded_nT])
    return {str(label): np.flatnonzero(coils == label) for label in np.unique(coils)}


def _partners(fields_nT: Array, others_nT: Array) -> NDArray[np.int64] | None:
    """Return for each shot the one of another group with its signs, coil by coil; None without."""
    signs = [tuple(np.sign(row[row != 0.0])) for row in fields_nT]
    theirs = [tuple(np.sign(row[row != 0.0])) for row in others_nT]
    if sorted(signs) != sorted(theirs) or len(set(signs)) < len(signs):
        return None
    return np.array([theirs.index(sign) for sign in signs])


def _agreeing(
    kind: Sequence[Relabelled], frequencies: Frequencies, *, known: bool
) -> Iterator[tuple[Relabelled, float]]:
    """Yield the statements of a kind with which the shots agree, and chi-square with them.

    Misfits of another cause, in any direction of as many dimensions as there are degrees of
    freedom, lie as near to one of so many statements with a chance that must be small.
    """
    for labels in kind:
        try:
            solution = solve(
                labels.commanded_nT,
                frequencies.omega_rad_per_s,
                frequencies.covariance,
                known=known,
            )
        except np.linalg.LinAlgError:
            continue
        freedom = solution.degrees_of_freedom
        settled = solution.converged and solution.positive_definite and freedom >= MIN_FREEDOM
        if not settled or solution.probability < DOUBTFUL:
            continue
        near = float(chdtri(freedom, DOUBTFUL)) / frequencies.solution.chi_square
        if len(kind) * near ** (0.5 * freedom) < BY_CHANCE:
            yield labels, solution.chi_square
