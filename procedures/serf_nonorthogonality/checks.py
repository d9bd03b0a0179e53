"""What the result should agree with: isotope, chi-square, closed form; and the published angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate

from .angles import PLACES
from .dataset import ANGLE, SLOWING_DOWN, Check, Frequencies, SerfDataset, ShotResult
from .shots import PAIRS, SPINS

Array = NDArray[np.float64]
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
    spin = SPINS[dataset.nuclear_spin]
    unseen = 0.0 if frequencies.failed is None else max(frequencies.chirp[0], 0.0)
    unseen += MARGIN_U * frequencies.chirp[1]
    return max(spin.polarised, spin.at_rest / (1.0 + unseen)), spin.at_rest


def outside_the_isotope(
    dataset: SerfDataset, frequencies: Frequencies, results: Sequence[Estimate]
) -> bool | None:
    """Tell whether the slowing-down factor cannot be the isotope's; None where there is none."""
    slowing_down = next(result for result in results if result.name == SLOWING_DOWN)
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
    shots: Sequence[ShotResult],
    frequencies: Frequencies | None,
    results: Sequence[Estimate],
    residual_nT: float | None,
) -> tuple[Check, ...]:
    """Return all checks in the order of the report."""
    if frequencies is None:
        return ()
    return (
        _isotope(dataset, frequencies, results),
        _chi_square(frequencies),
        _closed_form(dataset, shots, frequencies, results),
        _axes(frequencies, results),
        _residual(residual_nT),
    )


def _isotope(dataset: SerfDataset, frequencies: Frequencies, results: Sequence[Estimate]) -> Check:
    low, high = slowing_down_bounds(dataset, frequencies)
    slowing_down = next(result for result in results if result.name == SLOWING_DOWN)
    outside = outside_the_isotope(dataset, frequencies, results)
    value = "undetermined" if slowing_down.value is None else f"{slowing_down.value:.4f}"
    return Check(
        "slowing-down factor is the isotope's",
        value,
        f"{low:.4g} to {high:.4g} at spin {dataset.nuclear_spin:g}",
        None if outside is None else not outside,
    )


def _chi_square(frequencies: Frequencies) -> Check:
    solution = frequencies.solution
    if solution.degrees_of_freedom < 1:
        return Check("chi-square", "as many shots as unknowns", "probability above 0.01 %", None)
    text = (
        f"{solution.chi_square:.1f} with {solution.degrees_of_freedom} degrees of freedom, "
        f"probability {100.0 * solution.probability:.3g} %"
    )
    return Check("chi-square", text, "probability above 0.01 %", not solution.disagree)


def _closed_form(
    dataset: SerfDataset,
    shots: Sequence[ShotResult],
    frequencies: Frequencies,
    results: Sequence[Estimate],
) -> Check:
    used = [k for k, shot in enumerate(shots) if shot.used]
    cosines = closed_form(dataset.commanded_nT[used], frequencies.omega_rad_per_s)
    what, wanted = "closed form against general solution", "within one standard uncertainty"
    if not cosines:
        return Check(what, "needs four polarities of each pair", wanted, None)
    apart = []
    for pair in PAIRS:
        angle = next(result for result in results if (result.name, result.axis) == (ANGLE, pair))
        if angle.value is None or angle.standard_uncertainty is None or abs(cosines[pair]) > 1.0:
            return Check(what, "no angle to compare", wanted, None)
        apart.append(
            (float(np.degrees(np.arccos(cosines[pair]))) - angle.value) / angle.standard_uncertainty
        )
    text = ", ".join(f"{pair} {part:+.2f} u" for pair, part in zip(PAIRS, apart, strict=True))
    return Check(what, text, wanted, max(abs(difference) for difference in apart) <= 1.0)


def _axes(frequencies: Frequencies, results: Sequence[Estimate]) -> Check:
    angles = [
        result.value for result in results if result.name == ANGLE and result.value is not None
    ]
    smallest = float(np.linalg.eigvalsh(frequencies.solution.gram)[0])
    near = all(LOWEST_DEG < angle < HIGHEST_DEG for angle in angles)
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


# Steps 4 to 7 as published: slowing-down factor from one shot, angles by the law of cosines,
#
#     Q = gamma B_x / w_x,  B_xy = Q w_xy / gamma,  cos theta = (B_xy² - B_x² - B_y²) / (2 B_x B_y)
#
# theta is the angle between the positive axes. The source takes the angle theta_1 inside the
# triangle and then theta = pi - theta_1, which is the same; theta_1 would be 89 deg for 91 deg.


@dataclass(frozen=True)
class PublishedAngles:
    """Angles in deg by pair, None where the rule cannot run, with the reason; and the factor."""

    angles_deg: dict[str, float | None]
    wanting: dict[str, str]
    slowing_down: float | None


def published_angles(
    commanded_nT: Array, omega: Array, gamma_rad_per_s_nT: float
) -> PublishedAngles:
    """Return the published angles from the first shot of each kind, coils taken for exact.

    `commanded_nT` (n, 3), `omega` (n,) in rad/s, NaN for a shot without one.
    """
    driven = commanded_nT != 0.0
    good = np.isfinite(omega)
    single = np.flatnonzero((driven.sum(axis=1) == 1) & good)
    if not len(single):
        text = "no shot with a single coil gives the slowing-down factor"
        return PublishedAngles(dict.fromkeys(PAIRS), dict.fromkeys(PAIRS, text), None)
    first = int(single[0])
    alone_nT = float(np.linalg.norm(commanded_nT[first]))
    factor = gamma_rad_per_s_nT * alone_nT / float(omega[first])
    angles: dict[str, float | None] = {}
    wanting: dict[str, str] = {}
    for pair in PAIRS:
        axes = ["xyz".index(axis) for axis in pair]
        wanted = np.zeros(3, dtype=bool)
        wanted[axes] = True
        rows = np.flatnonzero(np.all(driven == wanted, axis=1) & good)
        angles[pair] = None
        if not len(rows):
            wanting[pair] = f"no usable shot drives {pair[0]} and {pair[1]}"
            continue
        # The source's shot has both fields positive; one of another polarity serves as well.
        positive = [k for k in rows if bool(np.all(commanded_nT[k, axes] > 0.0))]
        k = int(positive[0] if positive else rows[0])
        one_nT, other_nT = (float(commanded_nT[k, axis]) for axis in axes)
        total_nT = factor * float(omega[k]) / gamma_rad_per_s_nT
        cosine = (total_nT**2 - one_nT**2 - other_nT**2) / (2.0 * one_nT * other_nT)
        if abs(cosine) > 1.0:
            wanting[pair] = f"the cosine would be {cosine:.3g}"
            continue
        angles[pair] = float(np.degrees(np.arccos(cosine)))
    return PublishedAngles(angles, wanting, factor)


def closed_form(commanded_nT: Array, omega: Array) -> dict[str, float]:
    """Return the cosine of each pair of coils whose four polarities were measured at equal fields.

    Mean of w² over the four is a_i² B_i² + a_j² B_j² + residual², its contrast 2 a_i a_j B_i B_j
    cos; the three pairs together give the a. Empty where a pair is wanting.
    """
    sums: dict[str, float] = {}
    contrasts: dict[str, float] = {}
    for pair in PAIRS:
        i, j = PLACES[pair]
        other = 3 - i - j
        inside = (
            (commanded_nT[:, i] != 0.0)
            & (commanded_nT[:, j] != 0.0)
            & (commanded_nT[:, other] == 0.0)
        )
        rows, square = commanded_nT[inside][:, [i, j]], omega[inside] ** 2
        signs = {tuple(row) for row in np.sign(rows).tolist()}
        sizes = np.abs(rows)
        if len(signs) < 4 or not bool(np.all(sizes == sizes[:1])):
            return {}
        means = [float(np.mean(square[_same(rows, sign)])) for sign in sorted(signs)]
        sums[pair] = float(np.mean(means))
        unlike = [sign[0] * sign[1] for sign in sorted(signs)]
        contrasts[pair] = float(np.mean(np.array(means) * np.array(unlike)))
    squares = {
        "x": 0.5 * (sums["xy"] + sums["xz"] - sums["yz"]),
        "y": 0.5 * (sums["xy"] + sums["yz"] - sums["xz"]),
        "z": 0.5 * (sums["xz"] + sums["yz"] - sums["xy"]),
    }
    if min(squares.values()) <= 0.0:
        return {}
    return {
        pair: contrasts[pair] / (2.0 * float(np.sqrt(squares[pair[0]] * squares[pair[1]])))
        for pair in PAIRS
    }


def _same(rows: Array, sign: Sequence[float]) -> NDArray[np.bool_]:
    return np.asarray(np.all(np.sign(rows) == np.asarray(sign), axis=1))
