"""What the result should agree with: isotope, chi-square, closed form, axes, residual field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from station.findings import Estimate

from .dataset import ANGLE, SLOWING_DOWN, CellTemperature, Check, Frequencies, SerfDataset
from .published import closed_form
from .shots import PAIRS, SPINS

MARGIN_U = 3.0
FACTOR_MARGIN = 0.02
"""A coil constant that is wrong by a per cent moves the factor by as much."""
EXACT_MARGIN, TAKEN_FOR_ZERO = 0.0005, 0.005
"""Where the constants are exact, for what the model leaves out, and for a little residual field."""
ACCEPTED_RESIDUAL_NT = 1.5
LOWEST_DEG, HIGHEST_DEG = 80.0, 100.0


def slowing_down_bounds(dataset: SerfDataset, frequencies: Frequencies) -> tuple[float, float]:
    """Return the slowing-down factors that a vapour of this isotope can show.

    The frequencies are those of the end, when the polarisation is gone; where a chirp may be there
    that is not taken off, the factor is smaller by as much.
    """
    spin, (chirp, chirp_u) = SPINS[dataset.nuclear_spin], frequencies.chirp
    unseen = MARGIN_U * chirp_u + (0.0 if frequencies.failed is None else max(chirp, 0.0))
    return max(spin.polarised, spin.at_rest / (1.0 + unseen)), spin.at_rest


def outside_the_isotope(
    dataset: SerfDataset, frequencies: Frequencies, slowing_down: Estimate
) -> bool | None:
    """Tell whether the slowing-down factor cannot be the isotope's; None where there is none."""
    if slowing_down.value is None or slowing_down.standard_uncertainty is None:
        return None
    low, high = slowing_down_bounds(dataset, frequencies)
    margin = FACTOR_MARGIN
    if dataset.constants_known and dataset.coil_u is not None:
        margin = EXACT_MARGIN if frequencies.solution.free_of_residual else TAKEN_FOR_ZERO
        margin += MARGIN_U * max(dataset.coil_u)
    room = MARGIN_U * slowing_down.standard_uncertainty + margin * slowing_down.value
    return not low - room <= slowing_down.value <= high + room


def checks_of(
    dataset: SerfDataset,
    frequencies: Frequencies | None,
    results: Sequence[Estimate],
    residual_nT: float | None,
) -> tuple[Check, ...]:
    """Return all checks in the order of the report."""
    if frequencies is None:
        return ()
    slowing_down = next(result for result in results if result.name == SLOWING_DOWN)
    angles = [result for result in results if result.name == ANGLE]
    low, high = slowing_down_bounds(dataset, frequencies)
    outside = outside_the_isotope(dataset, frequencies, slowing_down)
    solution = frequencies.solution
    chi_square, agree = "as many shots as unknowns", None
    if solution.degrees_of_freedom > 0:
        agree = not solution.disagree
        chi_square = (
            f"{solution.chi_square:.1f} with {solution.degrees_of_freedom} degrees of freedom, "
            f"probability {100.0 * solution.probability:.3g} %"
        )
    smallest = float(np.linalg.eigvalsh(solution.gram)[0])
    known_deg = [angle.value for angle in angles if angle.value is not None]
    near = smallest > 0.0 and all(LOWEST_DEG < angle < HIGHEST_DEG for angle in known_deg)
    return (
        Check(
            "slowing-down factor is the isotope's",
            "undetermined" if slowing_down.value is None else f"{slowing_down.value:.4f}",
            f"{low:.4g} to {high:.4g} at spin {dataset.nuclear_spin:g}",
            None if outside is None else not outside,
        ),
        Check("chi-square", chi_square, "probability above 0.01 %", agree),
        Check(
            "closed form against general solution",
            *_apart(frequencies, angles),
        ),
        Check(
            "three axes with these angles exist",
            f"smallest eigenvalue of the Gram matrix {smallest:.4f}",
            f"positive, every angle between {LOWEST_DEG:g} and {HIGHEST_DEG:g} deg",
            near if known_deg else None,
        ),
        Check(
            "residual field",
            "undetermined" if residual_nT is None else f"{residual_nT:.3f} nT",
            f"below {ACCEPTED_RESIDUAL_NT:g} nT",
            None if residual_nT is None else residual_nT < ACCEPTED_RESIDUAL_NT,
        ),
        *([] if dataset.cell is None else [_warmth(dataset.cell)]),
    )


def _warmth(cell: CellTemperature) -> Check:
    """Return how warm the cell was before the shots, and whether it stayed as it was to be."""
    low, high = min(cell.seen_degC), max(cell.seen_degC)
    mean = sum(cell.seen_degC) / len(cell.seen_degC)
    u = "u not stated" if cell.u_K is None else f"u {cell.u_K:.2f} K"
    return Check(
        "temperature of the cell",
        f"{mean:.2f} degC, {u}; {low:.2f} degC to {high:.2f} degC before the shots",
        f"{cell.wanted_degC:g} degC within {cell.within_K:g} K",
        max(high - cell.wanted_degC, cell.wanted_degC - low) <= cell.within_K,
    )


def _apart(frequencies: Frequencies, angles: Sequence[Estimate]) -> tuple[str, str, bool | None]:
    """Return how far the closed form is from the angles, in words, and whether that is little."""
    wanted = "within one standard uncertainty"
    cosines = closed_form(frequencies.commanded_nT, frequencies.omega_rad_per_s)
    if not cosines:
        return "needs four polarities of each pair", wanted, None
    apart = {
        pair: (float(np.degrees(np.arccos(cosines[pair]))) - angle.value)
        / angle.standard_uncertainty
        for pair, angle in zip(PAIRS, angles, strict=True)
        if angle.value is not None and angle.standard_uncertainty and abs(cosines[pair]) <= 1.0
    }
    if len(apart) < len(PAIRS):
        return "no angle to compare", wanted, None
    text = ", ".join(f"{pair} {part:+.2f} u" for pair, part in apart.items())
    return text, wanted, max(abs(part) for part in apart.values()) <= 1.0
