"""What the reader must know about the shots and the solution, one flag a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .checks import outside_the_isotope, slowing_down_bounds
from .chirped import Frequencies
from .dataset import PAIRS, SerfDataset
from .findings import AnalysisSettings, Estimate, Flag
from .precession import Precession
from .published import PublishedAngles
from .results import ANGLE, FACTOR, RESIDUAL, SLOWING_DOWN, scale_axis

LARGE_BASELINE = 1.5
"""A baseline beyond this many amplitudes of the tone."""
CHANCE = 4.0


def data_flags(
    dataset: SerfDataset, seen: Sequence[Precession], settings: AnalysisSettings
) -> list[Flag]:
    """Return the flags on the shots themselves."""
    flags = [*_repeated(dataset), *_overload(seen), *_rejected(seen), *_outliers(seen)]
    return [*flags, *_gap(dataset, settings), *_shape(seen, settings)]


def _names(seen: Sequence[Precession]) -> str:
    return ", ".join(one.shot.name for one in seen)


def _repeated(dataset: SerfDataset) -> list[Flag]:
    if not dataset.repeated:
        return []
    names = list(dict.fromkeys(name for name, _ in dataset.repeated))
    why = "; ".join(dict.fromkeys(reason for _, reason in dataset.repeated))
    said = f"Shots were taken again, the bad ones are left out: {', '.join(names)} ({why})."
    return [Flag("shot-repeated", said, None, {"shots": names, "count": len(dataset.repeated)})]


def _overload(seen: Sequence[Precession]) -> list[Flag]:
    over = [one for one in seen if one.saturated]
    if not over:
        return []
    count = sum(one.saturated for one in over)
    said = f"{count} samples are saturated and left out, in {_names(over)}."
    return [
        Flag("overload", said, None, {"count": count, "shots": [one.shot.name for one in over]})
    ]


def _rejected(seen: Sequence[Precession]) -> list[Flag]:
    return [
        Flag(
            "shot-rejected",
            f"The shot {one.shot.name} is not used: {one.rejected}.",
            None,
            {"shot": one.shot.name},
        )
        for one in seen
        if not one.used
    ]


def _outliers(seen: Sequence[Precession]) -> list[Flag]:
    # Samples left out before the fit are saturated or early, not far from it.
    beyond = {
        one.shot.name: int(
            np.sum(~one.fit.kept & (np.abs(one.fit.residual_V) > 5.0 * one.fit.noise_V))
        )
        for one in seen
        if one.fit is not None and one.used and not one.saturated
    }
    count = sum(beyond.values())
    if not count:
        return []
    said = (
        f"{count} samples stand more than six standard deviations from the fit and are left out, "
        f"in {', '.join(name for name, number in beyond.items() if number)}."
    )
    return [Flag("outliers-rejected", said, None, {"count": count})]


def _gap(dataset: SerfDataset, settings: AnalysisSettings) -> list[Flag]:
    nominal_s = 1.0 / dataset.sample_rate_Hz
    gaps, missing = 0, 0
    for shot in dataset.shots:
        steps = np.diff(shot.time_s) / nominal_s
        wide = steps > settings.gap
        gaps += int(wide.sum())
        missing += int(np.sum(np.rint(steps[wide]) - 1.0))
    if not gaps:
        return []
    said = f"The records have {gaps} gaps with {missing} missing samples; the fits do not mind."
    return [Flag("gap", said, None, {"count": gaps, "missing_samples": missing})]


def _shape(seen: Sequence[Precession], settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on what the fits of single shots show."""
    flags = []
    used = [one for one in seen if one.fit is not None]
    few = [one for one in used if one.used_fit.cycles < settings.few_cycles]
    if few:
        least = min(few, key=lambda one: one.used_fit.cycles)
        flags.append(
            Flag(
                "few-cycles",
                f"Fewer than {settings.few_cycles:g} cycles pass within the 1/e time in "
                f"{_names(few)}, the fewest in {least.shot.name}, {least.used_fit.cycles:.2f}; a "
                "larger field would be told better.",
                None,
                {"shots": [one.shot.name for one in few], "cycles": least.used_fit.cycles},
            )
        )
    large = [
        one
        for one in used
        if one.used and abs(one.used_fit.baseline_V) > LARGE_BASELINE * one.used_fit.amplitude_V
    ]
    if large:
        flags.append(
            Flag(
                "baseline",
                f"The decaying baseline is larger than {LARGE_BASELINE:g} amplitudes of the tone "
                f"in {_names(large)}: the field lies near pump and probe.",
                None,
                {"shots": [one.shot.name for one in large]},
            )
        )
    return flags


def result_flags(
    dataset: SerfDataset,
    found: Frequencies | None,
    results: Sequence[Estimate],
    paper: PublishedAngles,
    residual_nT: float | None,
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the solution: what it cannot tell and what stands against it."""
    flags = _not_identifiable(dataset, found, results)
    flags += [
        Flag("not-identifiable", f"As published the angle {pair} is undetermined: {why}.", pair)
        for pair, why in paper.wanting.items()
    ]
    if found is None:
        return flags
    flags += _scale(dataset, found, results)
    if residual_nT is not None and residual_nT > settings.residual_field_nT:
        flags.append(
            Flag(
                "residual-field-large",
                f"The residual field is {residual_nT:.2f} nT, more than "
                f"{settings.residual_field_nT:g} nT: null it again, or depolarise the nuclei "
                "(step 1), whose field moves during the shots.",
                None,
                {"field_nT": residual_nT},
            )
        )
    flags += _chirp(found, settings) + _disagree(found) + _stiff(found, settings)
    if outside_the_isotope(dataset, results):
        low, high = slowing_down_bounds(dataset.nuclear_spin)
        flags.append(
            Flag(
                "slowing-down-factor-outside",
                f"The slowing-down factor lies outside the isotope's {low:.4g} to {high:.4g}: the "
                "commanded fields, the unit of the gyromagnetic ratio, the sample rate or the "
                "nuclear spin are wrong.",
            )
        )
    return flags


def _not_identifiable(
    dataset: SerfDataset, found: Frequencies | None, results: Sequence[Estimate]
) -> list[Flag]:
    flags = []
    angles = [one.axis for one in results if one.name == ANGLE and one.value is None]
    rest = [one.axis for one in results if one.name == RESIDUAL and one.value is None]
    factors = [one.axis for one in results if one.name == FACTOR and one.value is None]
    if angles:
        why = "the shots determine them only with the coil constants known"
        if found is None:
            why = "no usable shot is left"
        elif not found.solution.positive_definite:
            why = "no three axes have the angles that the shots lead to"
        elif not found.solution.converged:
            why = "the solution does not settle"
        elif dataset.constants_known or len(angles) < len(PAIRS):
            why = "the shots do not determine them"
        names = [f"{ANGLE} {pair}" for pair in angles]
        names += [f"{FACTOR} {axis}" for axis in factors]
        flags.append(
            Flag(
                "not-identifiable",
                f"Angles {', '.join(str(one) for one in angles)} are undetermined: {why}.",
                None,
                {"coefficients": names},
            )
        )
    if rest:
        flags.append(
            Flag(
                "not-identifiable",
                "The residual field is undetermined: that takes shots of either polarity; the "
                "angles take it for zero.",
                None,
                {"coefficients": [f"{RESIDUAL} {axis}" for axis in rest]},
            )
        )
    if all(one.value is None for one in results if one.name == SLOWING_DOWN):
        flags.append(
            Flag(
                "not-identifiable",
                "The slowing-down factor is undetermined.",
                None,
                {"coefficients": [SLOWING_DOWN]},
            )
        )
    return flags


def _scale(dataset: SerfDataset, found: Frequencies, results: Sequence[Estimate]) -> list[Flag]:
    axis = scale_axis(dataset, found.solution)
    if dataset.constants_known or axis is None:
        return []
    return [
        Flag(
            "scale-by-convention",
            f"Only coil factors over the slowing-down factor are seen: that of coil {axis} is one "
            "by convention, the others, the residual field and the slowing-down factor are "
            "relative to it; the angles do not depend on it.",
            axis,
        )
    ]


def _chirp(found: Frequencies, settings: AnalysisSettings) -> list[Flag]:
    if found.failed is not None:
        return [
            Flag(
                "chirp",
                f"The frequency falls by about {100.0 * found.chirp:.2g} % over the decay, and the "
                f"joint fit failed ({found.failed}): the uncertainties do not cover what that does "
                "to the angles.",
                None,
                {"relative_change": found.chirp},
            )
        ]
    if found.chirp <= settings.chirp or found.chirp <= settings.chirp_u * found.chirp_u:
        return []
    polarisation = found.joint.polarisation if found.joint is not None else np.nan
    return [
        Flag(
            "chirp",
            f"The frequency falls by {100.0 * found.chirp:.2g} % over the decay, as a polarisation "
            f"of {polarisation:.2f} fades; all shots were fitted jointly. What a lean of the pump "
            "light against the coils does is in the uncertainty.",
            None,
            {"relative_change": found.chirp, "polarisation": polarisation},
        )
    ]


def _disagree(found: Frequencies) -> list[Flag]:
    solution = found.solution
    if not solution.enlarged:
        return []
    return [
        Flag(
            "shots-disagree",
            f"Chi-square of the shots is {solution.chi_square:.1f} with "
            f"{solution.degrees_of_freedom} degrees of freedom: the fields were not steady from "
            "shot to shot; the uncertainties are enlarged accordingly.",
            None,
            {"chi_square": solution.chi_square},
        )
    ]


def _stiff(found: Frequencies, settings: AnalysisSettings) -> list[Flag]:
    """Return a flag where neighbouring residuals of the fits go together."""
    if found.joint is not None:
        residuals = list(found.joint.residual_V)
    else:
        residuals = list(found.single_residual_V)
    worst = 0.0
    for one in residuals:
        power = float(one @ one)
        share = float(one[1:] @ one[:-1]) / power if power > 0.0 else 0.0
        worst = max(worst, share if share > CHANCE / np.sqrt(len(one)) else 0.0)
    if worst <= settings.model_too_stiff:
        return []
    return [
        Flag(
            "model-too-stiff",
            f"Neighbouring residuals of a shot are correlated by {worst:.2f}: the fit does not "
            "follow the signal.",
            None,
            {"lag_one_correlation": worst},
        )
    ]
