"""What the result should agree with: the isotope, its own chi-square, the closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from station.findings import Estimate

from .angles import closed_form
from .dataset import SerfDataset
from .findings import Check, ShotResult
from .frequencies import Frequencies
from .results import ANGLE, SLOWING_DOWN
from .shots import PAIRS
from .spins import SPINS

MARGIN_U = 3.0
FACTOR_MARGIN = 0.02
"""A coil constant that is wrong by a per cent moves the factor by as much."""
EXACT_MARGIN, TAKEN_FOR_ZERO = 0.0005, 0.005
"""Where the constants are exact, for what the model leaves out, and for a little residual field."""
ACCEPTED_RESIDUAL_NT = 1.5
LOWEST_DEG, HIGHEST_DEG = 80.0, 100.0


def slowing_down_bounds(dataset: SerfDataset, found: Frequencies) -> tuple[float, float]:
    """Return the slowing-down factors that a vapour of this isotope can show.

    The frequencies are those of the end, when the polarisation is gone; where a chirp may be there
    that is not taken off, the factor is smaller by as much.
    """
    spin = SPINS[dataset.nuclear_spin]
    unseen = 0.0 if found.failed is None else max(found.chirp, 0.0)
    unseen += MARGIN_U * found.chirp_u
    return max(spin.polarised, spin.at_rest / (1.0 + unseen)), spin.at_rest


def outside_the_isotope(
    dataset: SerfDataset, found: Frequencies, results: Sequence[Estimate]
) -> bool | None:
    """Tell whether the slowing-down factor cannot be the isotope's; None where there is none."""
    one = next(one for one in results if one.name == SLOWING_DOWN)
    if one.value is None or one.standard_uncertainty is None:
        return None
    low, high = slowing_down_bounds(dataset, found)
    margin = FACTOR_MARGIN
    if dataset.constants_known and dataset.coil_u is not None:
        margin = EXACT_MARGIN if found.solution.free_of_residual else TAKEN_FOR_ZERO
        margin += MARGIN_U * max(dataset.coil_u)
    room = MARGIN_U * one.standard_uncertainty + margin * one.value
    return not low - room <= one.value <= high + room


def checks_of(
    dataset: SerfDataset,
    shots: Sequence[ShotResult],
    found: Frequencies | None,
    results: Sequence[Estimate],
    residual_nT: float | None,
) -> tuple[Check, ...]:
    """Return all checks in the order of the report."""
    if found is None:
        return ()
    return (
        _isotope(dataset, found, results),
        _chi_square(found),
        _closed_form(dataset, shots, found, results),
        _axes(found, results),
        _residual(residual_nT),
    )


def _isotope(dataset: SerfDataset, found: Frequencies, results: Sequence[Estimate]) -> Check:
    low, high = slowing_down_bounds(dataset, found)
    one = next(one for one in results if one.name == SLOWING_DOWN)
    outside = outside_the_isotope(dataset, found, results)
    value = "undetermined" if one.value is None else f"{one.value:.4f}"
    return Check(
        "slowing-down factor is the isotope's",
        value,
        f"{low:.4g} to {high:.4g} at spin {dataset.nuclear_spin:g}",
        None if outside is None else not outside,
    )


def _chi_square(found: Frequencies) -> Check:
    solution = found.solution
    if solution.degrees_of_freedom < 1:
        return Check("chi-square", "as many shots as unknowns", "probability above 0.01 %", None)
    said = (
        f"{solution.chi_square:.1f} with {solution.degrees_of_freedom} degrees of freedom, "
        f"probability {100.0 * solution.probability:.3g} %"
    )
    return Check("chi-square", said, "probability above 0.01 %", not solution.disagree)


def _closed_form(
    dataset: SerfDataset,
    shots: Sequence[ShotResult],
    found: Frequencies,
    results: Sequence[Estimate],
) -> Check:
    used = [k for k, shot in enumerate(shots) if shot.used]
    cosines = closed_form(dataset.commanded_nT[used], found.omega_rad_per_s)
    what, wanted = "closed form against general solution", "within one standard uncertainty"
    if not cosines:
        return Check(what, "needs four polarities of each pair", wanted, None)
    apart = []
    for pair in PAIRS:
        one = next(one for one in results if (one.name, one.axis) == (ANGLE, pair))
        if one.value is None or one.standard_uncertainty is None or abs(cosines[pair]) > 1.0:
            return Check(what, "no angle to compare", wanted, None)
        apart.append(
            (float(np.degrees(np.arccos(cosines[pair]))) - one.value) / one.standard_uncertainty
        )
    said = ", ".join(f"{pair} {part:+.2f} u" for pair, part in zip(PAIRS, apart, strict=True))
    return Check(what, said, wanted, max(abs(one) for one in apart) <= 1.0)


def _axes(found: Frequencies, results: Sequence[Estimate]) -> Check:
    angles = [one.value for one in results if one.name == ANGLE and one.value is not None]
    smallest = float(np.linalg.eigvalsh(found.solution.gram)[0])
    near = all(LOWEST_DEG < one < HIGHEST_DEG for one in angles)
    return Check(
        "three axes with these angles exist",
        f"smallest eigenvalue of the Gram matrix {smallest:.4f}",
        f"positive, every angle between {LOWEST_DEG:g} and {HIGHEST_DEG:g} deg",
        smallest > 0.0 and near if angles else None,
    )


def _residual(residual_nT: float | None) -> Check:
    what, wanted = "residual field", f"below {ACCEPTED_RESIDUAL_NT:g} nT"
    if residual_nT is None:
        return Check(what, "undetermined", wanted, None)
    return Check(what, f"{residual_nT:.3f} nT", wanted, residual_nT < ACCEPTED_RESIDUAL_NT)
