"""What the reader must know about the solution, one flag a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from procedures.estimation.flags import not_identifiable, too_stiff
from station.findings import NOT_IDENTIFIABLE, Estimate, Flag, contradiction

from .checks import PublishedAngles, outside_the_isotope, slowing_down_bounds
from .dataset import ANGLE, FACTOR, RESIDUAL, SLOWING_DOWN, Frequencies, SerfDataset, scale_axis
from .parameters import AnalysisSettings
from .shots import PAIRS

CHANCE = 4.0
DRIFT_U = 4.0
FADING_U = 5.0


def result_flags(
    dataset: SerfDataset,
    frequencies: Frequencies | None,
    results: Sequence[Estimate],
    paper: PublishedAngles,
    residual_nT: float | None,
    settings: AnalysisSettings,
) -> Iterator[Flag]:
    """Yield the flags on the solution: what it cannot determine and what stands against it."""
    yield from _not_identifiable(dataset, frequencies, results)
    for pair, why in paper.wanting.items():
        text = f"As published the angle {pair} is undetermined: {why}."
        yield Flag(NOT_IDENTIFIABLE, text, pair)
    if frequencies is None:
        return
    axis = scale_axis(dataset, frequencies.solution)
    if axis is not None and not dataset.constants_known:
        yield Flag(
            "scale-by-convention",
            f"Only coil factors over the slowing-down factor are seen: that of coil {axis} is one "
            "by convention, the others, the residual field and the slowing-down factor are "
            "relative to it; the angles do not depend on it.",
            axis,
        )
    if residual_nT is not None and residual_nT > settings.residual_field_large_nT:
        yield Flag(
            "residual-field-large",
            f"The residual field is {residual_nT:.2f} nT, more than "
            f"{settings.residual_field_large_nT:g} nT: null it again, or depolarise the nuclei "
            "(step 1), whose field moves during the shots.",
            details={"field_nT": residual_nT},
        )
    yield from _frequency_flags(dataset, frequencies, settings)
    yield from _fit_flags(frequencies, settings)
    if outside_the_isotope(dataset, frequencies, results):
        low, high = slowing_down_bounds(dataset, frequencies)
        yield Flag(
            "slowing-down-factor-outside",
            f"The slowing-down factor lies outside the isotope's {low:.4g} to {high:.4g}: the "
            "commanded fields, the coil constants, a residual field taken for zero, the unit "
            "of the gyromagnetic ratio, the sample rate or the nuclear spin are wrong. Check "
            "them in this order.",
        )


def _not_identifiable(
    dataset: SerfDataset, frequencies: Frequencies | None, results: Sequence[Estimate]
) -> Iterator[Flag]:
    null = {
        name: [result.axis for result in results if result.name == name and result.value is None]
        for name in (ANGLE, RESIDUAL, FACTOR, SLOWING_DOWN)
    }
    angles = null[ANGLE]
    if angles:
        why = "the shots determine them only with the coil constants known"
        if frequencies is None:
            why = "no usable shot is left"
        elif not frequencies.solution.positive_definite:
            why = "no three axes have the angles that the shots lead to"
        elif not frequencies.solution.converged:
            why = "the solution does not settle"
        elif dataset.constants_known or len(angles) < len(PAIRS):
            why = "the shots do not determine them"
        coefficients = [f"{ANGLE} {pair}" for pair in angles]
        coefficients += [f"{FACTOR} {axis}" for axis in null[FACTOR]]
        text = f"Angles {', '.join(str(angle) for angle in angles)} are undetermined: {why}."
        yield not_identifiable(text, coefficients)
    if null[RESIDUAL]:
        yield not_identifiable(
            "The residual field is undetermined: that takes shots of either polarity; the "
            "angles take it for zero.",
            [f"{RESIDUAL} {axis}" for axis in null[RESIDUAL]],
        )
    if null[SLOWING_DOWN]:
        yield not_identifiable("The slowing-down factor is undetermined.", [SLOWING_DOWN])


def _frequency_flags(
    dataset: SerfDataset, frequencies: Frequencies, settings: AnalysisSettings
) -> Iterator[Flag]:
    """Yield the flags of frequencies that fall, drift, or fall as if the lights changed places."""
    chirp, chirp_u = frequencies.chirp
    if frequencies.failed is not None:
        yield Flag(
            "chirp",
            f"The frequency falls by about {100.0 * chirp:.2g} % over the decay, and the "
            f"joint fit failed ({frequencies.failed}): the uncertainties do not cover what that "
            "does to the angles.",
            details={"relative_change": chirp},
        )
    elif chirp > settings.chirp and chirp > settings.chirp_u * chirp_u:
        polarisation = frequencies.joint.polarisation if frequencies.joint is not None else np.nan
        yield Flag(
            "chirp",
            f"The frequency falls by {100.0 * chirp:.2g} % over the decay, as a polarisation "
            f"of {polarisation:.2f} fades; all shots were fitted jointly. How the spins lay to "
            "the fields comes from the baselines.",
            details={"relative_change": chirp, "polarisation": polarisation},
        )
    drift, drift_u = frequencies.drift_per_s
    if abs(drift) > DRIFT_U * drift_u:
        yield Flag(
            "misfit",
            f"The frequencies drift by {100.0 * drift:.2g} % per second during "
            f"the records, {abs(drift) / drift_u:.1f} u, beside what "
            "a fading polarisation does: the fields are not steady, or the recorder's clock is "
            "not. The slowing-down factor is off by more than its u; measure the coil currents "
            "during a record.",
            details={"drift_per_s": drift},
        )
    fading, fading_u = frequencies.fading
    if abs(fading) > FADING_U * fading_u:
        how = "faster" if fading > 0.0 else "more slowly"
        yield Flag(
            "misfit",
            f"The tone of the last shot fades {abs(100.0 * fading):.2g} % {how} than "
            f"that of the first, {abs(fading) / fading_u:.1f} u: the "
            "cell's temperature, the probe light or what leaks of the pump light was not steady. "
            "Wait until the cell is warm, and repeat the shots.",
            details={"fading": fading},
        )
    if frequencies.exchanged:
        yield contradiction(
            "pump_axis",
            f"The pump light is stated along {dataset.pump_axis} and the probe along "
            f"{dataset.probe_axis}, and the frequencies fall as if it were the other way round: "
            "correct pump_axis and probe_axis.",
        )


def _fit_flags(frequencies: Frequencies, settings: AnalysisSettings) -> Iterator[Flag]:
    """Yield the flags of shots that disagree, and of fits whose neighbouring residuals do not."""
    solution = frequencies.solution
    if solution.disagree:
        yield Flag(
            "shots-disagree",
            f"Chi-square of the shots is {solution.chi_square:.1f} with "
            f"{solution.degrees_of_freedom} degrees of freedom: the fields were not steady from "
            "shot to shot, or shots stand under wrong names or commanded fields; the uncertainties "
            "are enlarged accordingly. Look at the shots' misfits, and repeat those that are off.",
            details={"chi_square": solution.chi_square},
        )
    worst = 0.0
    for residual_V in frequencies.residual_V:
        power = float(residual_V @ residual_V)
        share = float(residual_V[1:] @ residual_V[:-1]) / power if power > 0.0 else 0.0
        worst = max(worst, share if share > CHANCE / np.sqrt(len(residual_V)) else 0.0)
    if worst > settings.model_too_stiff:
        yield too_stiff(worst, " of a shot", "the fit does not follow the signal")
