"""Whether the shots agree with one another, and the coil constants with the shots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from station.findings import Flag

from .angles import DOUBTFUL, IMPROBABLE, Solution, solve
from .dataset import SerfDataset
from .findings import AnalysisSettings
from .frequencies import Frequencies, frequencies_and_angles
from .precession import Precession
from .shots import AXES

LEAST_FREEDOM = 2
MODEL_U = 5e-5
"""Relative, of a coil factor: what spin exchange does to a frequency and the model may miss."""


def agreed(
    dataset: SerfDataset, seen: Sequence[Precession], settings: AnalysisSettings
) -> tuple[SerfDataset, list[Precession], Frequencies, list[Flag]]:
    """Return dataset and shots as they are believed, with the solution and what speaks against.

    A single shot that all others contradict is left out. Coil constants that the shots contradict
    are solved for: the dataset that is returned does not have them known. Raises LinAlgError, and
    ValueError without a usable shot.
    """
    shots = list(seen)
    found = frequencies_and_angles(dataset, _used(shots), settings)
    odd = _odd_one(_used(shots), found)
    if odd is not None:
        place = next(k for k, one in enumerate(shots) if one is odd[0])
        shots[place] = replace(odd[0], rejected=odd[1])
        found = frequencies_and_angles(dataset, _used(shots), settings)
    if not dataset.constants_known:
        return dataset, shots, found, []
    free = _solved(_used(shots), found, range(len(found.omega_rad_per_s)))
    known = found.solution
    if free is None or not all(free.determined[:3]):
        return dataset, shots, found, []
    if known.degrees_of_freedom <= free.degrees_of_freedom:
        return dataset, shots, found, []
    ratios, covariance = free.ratios()
    chance = _chance(ratios, covariance)
    if chance >= DOUBTFUL:
        return dataset, shots, found, []
    if chance >= IMPROBABLE:
        # Too little to overrule what is stated, too much to count on it: what it moves is in u.
        moved = np.concatenate(
            [known.scale - free.scale, known.cosine - free.cosine, known.residual - free.residual]
        )
        wide = replace(known, covariance=known.covariance + np.outer(moved, moved))
        return dataset, shots, replace(found, solution=wide), []
    dataset = replace(dataset, constants_known=False)
    found = frequencies_and_angles(dataset, _used(shots), settings)
    flags = []
    stated = np.square(dataset.coil_u or (0.0, 0.0, 0.0)) + MODEL_U**2
    if _chance(ratios, covariance + np.diag(stated[1:]) + stated[0]) < IMPROBABLE:
        said = " and ".join(
            f"{axis} {1.0 + ratio:.5f}" for axis, ratio in zip(AXES[1:], ratios, strict=True)
        )
        flags.append(
            Flag(
                "contradicts-statement",
                f"The coil constants are stated as known, and the shots deny it: relative to coil "
                f"x the factors are {said}. They are solved for, as with nominal constants. "
                "Calibrate the coils, or look for a wrong commanded field or a supply's range.",
                None,
                {"statement": "coil_constants"},
            )
        )
    return dataset, shots, found, flags


def _used(shots: Sequence[Precession]) -> list[Precession]:
    return [one for one in shots if one.used]


def _solved(used: Sequence[Precession], found: Frequencies, rows: Sequence[int]) -> Solution | None:
    """Return the solution of some of the shots, coil constants left free; None without one."""
    at = np.array(rows)
    commanded_nT = np.array([used[k].shot.field_nT for k in rows])
    covariance = found.covariance[np.ix_(at, at)]
    try:
        one = solve(commanded_nT, found.omega_rad_per_s[at], covariance, known=False)
    except np.linalg.LinAlgError:
        return None
    return one if one.converged and one.positive_definite else None


def _chance(ratios: np.ndarray, covariance: np.ndarray) -> float:
    """Return how probable ratios as far from zero as these are."""
    return float(chdtrc(len(ratios), float(ratios @ np.linalg.solve(covariance, ratios))))


def _odd_one(used: Sequence[Precession], found: Frequencies) -> tuple[Precession, str] | None:
    """Return the only shot without which the others agree, and why it is not used; None without."""
    count = len(used)
    whole = _solved(used, found, range(count))
    if whole is None or whole.degrees_of_freedom < LEAST_FREEDOM or not whole.disagree:
        return None
    without = np.zeros(count)
    for k in range(count):
        one = _solved(used, found, [n for n in range(count) if n != k])
        if one is not None and one.determined == whole.determined:
            without[k] = one.probability
    second, best = np.argsort(without)[-2:]
    if without[best] < DOUBTFUL or without[second] >= IMPROBABLE:
        return None
    return used[best], (
        "all others agree and its frequency contradicts them: its name or its commanded field is "
        "wrong, or the field was not steady; look at its supply and repeat it"
    )
