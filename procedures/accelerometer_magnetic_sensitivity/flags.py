"""What the reader must know about a solution, one flag a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from procedures.estimation.flags import not_identifiable, too_stiff
from station.findings import Estimate, Flag, combination_text

from .model import COEFFICIENTS, Identifiability, describe, listed
from .nuisances import KI_DRIFT
from .parameters import AnalysisSettings
from .solved import Solution

MAGNETIC = ("Km", "Kmm", "Kim", "Kom", "Kpm")


def solution_flags(
    solution: Solution, coarse_V: float, settings: AnalysisSettings
) -> Iterator[Flag]:
    """Yield the flags on a solution: drift, what groups of rows share, its noise, rounding.

    `coarse_V` is the step that the readings are multiples of.
    """
    if solution.drift_order:
        yield Flag(
            "drift-removed",
            f"The output drifted; a polynomial in time of order {solution.drift_order} with zero "
            "mean over the rows was fitted with the coefficients and removed.",
            details={"order": solution.drift_order},
        )
    if KI_DRIFT in solution.names:
        yield Flag(
            "drift-removed",
            "The scale factor drifted, and no temperature says why: a term linear in time, of zero "
            "mean over the rows, was fitted and removed.",
            details={"term": "Ki"},
        )
    if solution.lag_one_correlation > settings.too_stiff_beyond(int(solution.kept.sum())):
        yield too_stiff(solution.lag_one_correlation)
    if coarse_V > solution.noise_V:
        yield Flag(
            "coarse-output",
            f"The output has steps of {1e6 * coarse_V:.4g} µV, and the noise that is left is "
            f"{1e6 * solution.noise_V:.3g} µV: rounding decides the uncertainty. Take a lower "
            "range or a longer integration, and write all digits into the file.",
            details={"step_V": coarse_V},
        )
    misfit, noise = solution.misfit, solution.uneven
    if misfit is not None:
        yield Flag(
            "misfit",
            f"The rows of the same {misfit.what} are off together, most in {misfit.largest} by "
            f"{1e6 * misfit.size_V:+.3g} µV: the model does not follow the output there. The "
            f"uncertainties are {misfit.ratio**0.5:.2g} times larger for it. Look at the encoder, "
            "the mounting, and what is not linear.",
            details={"what": misfit.what, "at": misfit.largest, "size_V": misfit.size_V},
        )
    if noise is not None:
        sizes = ", ".join(f"{1e6 * noise_V:.3g}" for noise_V in noise.noise_V)
        where = "the planes in alphabetic order" if noise.what == "plane" else "thirds of the rows"
        yield Flag(
            "uneven-noise",
            f"The noise is not even: {sizes} µV in {where}. Each row weighs by its own. Look for "
            "what disturbed the noisy part: a loose cable, a motor, a range of the voltmeter.",
            details={"by": noise.what, "noise_V": [float(noise_V) for noise_V in noise.noise_V]},
        )


def result_flags(
    planned: Identifiability,
    measured: Identifiability,
    estimates: Sequence[Estimate],
    unsolved: str,
    settings: AnalysisSettings,
) -> Iterator[Flag]:
    """Yield the flags on the results: what they stand for, and which are as good as zero.

    `unsolved` says why there is no solution, where there is none.
    """
    undetermined = {estimate.name for estimate in estimates if estimate.value is None}
    wanting = [n for n in COEFFICIENTS if n in planned.not_alone or n in undetermined]
    if wanting:
        why = unsolved or " ".join(describe(measured))
        yield not_identifiable(f"Not every coefficient is determined alone. {why}", wanting)
    moved = [name for name, own in measured.terms.items() if own != planned.terms[name]]
    if moved:
        combinations = ", ".join(combination_text(measured.terms[name], 6) for name in moved)
        what = f"what {listed(moved)} {'stands' if len(moved) == 1 else 'stand'} for"
        yield Flag(
            "field-differs-from-commanded",
            "The fields or angles that were measured are not those that were commanded, and move "
            f"{what}: {combinations}. The terms given are those of the measured ones.",
            details={"coefficients": moved},
        )
    weak = [
        estimate.name
        for estimate in estimates
        if estimate.name in MAGNETIC
        and estimate.value is not None
        and abs(estimate.value) < settings.not_significant * (estimate.standard_uncertainty or 0.0)
    ]
    if weak:
        yield Flag(
            "not-significant",
            f"{listed(weak)} cannot be distinguished from zero: the magnitude is below "
            f"{settings.not_significant:g} standard uncertainties.",
            details={"coefficients": weak},
        )
