"""Which other statement of the commanded fields lets shots agree that contradict one another.

Frequencies do not tell a coil that is reversed in one pair from one that is reversed in all others:
both are named. A coil that is reversed in all shots changes no chi-square and is not seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from procedures.estimation.readings import Reading, Remainder, named, suiting
from station.findings import Flag, contradiction

from .angles import DOUBTFUL, solve
from .dataset import Frequencies, SerfDataset
from .shots import AXES

Array = NDArray[np.float64]
Index = NDArray[np.int64]
MIN_FREEDOM = 2


def relabelled_flags(dataset: SerfDataset, frequencies: Frequencies | None) -> Iterator[Flag]:
    """Yield a flag that names what was probably commanded, where shots disagree as stated."""
    if frequencies is None or not frequencies.solution.disagree:
        return
    commanded_nT = frequencies.commanded_nT
    names = [shot.name for shot in frequencies.used]
    kinds = (reversals(commanded_nT), pairs_mistaken(commanded_nT), swaps(commanded_nT, names))
    suits = suiting(
        commanded_nT,
        [list(kind) for kind in kinds],
        lambda meant_nT: _remainder(meant_nT, frequencies, known=dataset.constants_known),
        stated=Remainder(frequencies.solution.chi_square, frequencies.solution.degrees_of_freedom),
    )
    if not suits:
        return
    concerned = sorted({names[k] for suit in suits for k in suit.reading.details["shots"]})
    yield contradiction(
        "shots",
        f"Chi-square of the shots falls from {frequencies.solution.chi_square:.1f} to "
        f"{suits[0].squares:.1f} if {named(suits)}. Correct the commanded fields of these "
        "shots, or their names; the angles hold that error.",
        shots=concerned,
    )


def reversals(commanded_nT: Array) -> Iterator[Reading[Array]]:
    """Yield the statements in which a coil, or both, were reversed in the shots of a pair."""
    groups = _groups(commanded_nT)
    for coils, rows in groups.items():
        for turned in dict.fromkeys((*coils, coils)) if len(groups) > 1 else ():
            meant = commanded_nT.copy()
            for axis in turned:
                meant[rows, AXES.index(axis)] *= -1.0
            what = f"coils {turned} were reversed in the shots of {coils}"
            if len(turned) == 1:
                what = f"coil {turned} was reversed in the shots of {coils}"
            yield _labels(what, rows, meant)


def pairs_mistaken(commanded_nT: Array) -> Iterator[Reading[Array]]:
    """Yield the statements in which the shots of a pair were taken with other coils."""
    for (coils, rows), (other, others) in permutations(_groups(commanded_nT).items(), 2):
        partner = _partners(commanded_nT[rows], commanded_nT[others])
        if partner is None:
            continue
        meant = commanded_nT.copy()
        meant[rows] = commanded_nT[others[partner]]
        yield _labels(f"the shots of {coils} were taken with the coils {other}", rows, meant)
        if coils < other:
            meant = meant.copy()
            meant[others[partner]] = commanded_nT[rows]
            what = f"the shots of {coils} and of {other} stand under each other's names"
            yield _labels(what, np.concatenate([rows, others]), meant)


def swaps(commanded_nT: Array, names: Sequence[str]) -> Iterator[Reading[Array]]:
    """Yield the statements in which two shots stand under each other's names."""
    for a, b in combinations(range(len(names)), 2):
        meant = commanded_nT.copy()
        meant[[a, b]] = commanded_nT[[b, a]]
        what = f"{names[a]} and {names[b]} stand under each other's names"
        yield _labels(what, np.array([a, b]), meant)


def _labels(what: str, shots: Index, commanded_nT: Array) -> Reading[Array]:
    """Return commanded fields (shots, 3) in nT that may have been meant, and in which shots."""
    return Reading(what, lambda _: commanded_nT, "shots", {"shots": shots})


def _groups(commanded_nT: Array) -> Mapping[str, Index]:
    """Return the rows of the shots that drive the same coils."""
    coils = np.array(["".join(np.array(AXES)[row != 0.0]) for row in commanded_nT])
    return {str(label): np.flatnonzero(coils == label) for label in np.unique(coils)}


def _partners(fields_nT: Array, others_nT: Array) -> Index | None:
    """Return for each shot the one of another group with its signs, coil by coil; None without."""
    signs = [tuple(np.sign(row[row != 0.0])) for row in fields_nT]
    theirs = [tuple(np.sign(row[row != 0.0])) for row in others_nT]
    if sorted(signs) != sorted(theirs) or len(set(signs)) < len(signs):
        return None
    return np.array([theirs.index(sign) for sign in signs])


def _remainder(commanded_nT: Array, frequencies: Frequencies, *, known: bool) -> Remainder | None:
    """Return what the shots leave as commanded, chi-square; None without a sound solution."""
    try:
        solution = solve(
            commanded_nT, frequencies.omega_rad_per_s, frequencies.covariance, known=known
        )
    except np.linalg.LinAlgError:
        return None
    freedom = solution.degrees_of_freedom
    if not (solution.sound and freedom >= MIN_FREEDOM):
        return None
    return Remainder(solution.chi_square, freedom, float(chdtri(freedom, DOUBTFUL)))
