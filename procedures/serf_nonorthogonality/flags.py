"""What the reader must know: of what is stated, of the shots, and of the solution."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from procedures.estimation.flags import (
    Gaps,
    excitation_flags,
    gaps_of,
    not_identifiable,
    too_stiff,
)
from procedures.estimation.plausibility import Bounds, implausible
from station.findings import NOT_IDENTIFIABLE, Estimate, Flag, contradiction

from .checks import outside_the_isotope, slowing_down_bounds
from .dataset import (
    ANGLE,
    FACTOR,
    RESIDUAL,
    SLOWING_DOWN,
    Frequencies,
    SerfDataset,
    ShotResult,
    scale_axis,
)
from .parameters import AnalysisSettings
from .shots import AXES, GAMMA_HZ_PER_NT, MIN_SIGNAL_TO_NOISE, PAIRS, SPINS

UNEXPLAINED = 0.3
"""Of the squares of the frequencies: what coils that lean leave at most."""
LARGE_BASELINE = 1.5
"""A baseline beyond this many amplitudes of the tone."""
GAMMA_MARGIN = 1e-3
"""Alkali atoms differ from the free electron, and from one another, by less than 2e-4."""
CLOCK_MARGIN = 2e-4
LATE = 3.0
"""1/e times after time zero at which no record begins: it would hold a twentieth of its tone."""
STIFF_U = 4.0
DRIFT_U = 4.0
FADING_U = 5.0


def data_flags(
    dataset: SerfDataset, shots: Sequence[ShotResult], settings: AnalysisSettings
) -> Iterator[Flag]:
    """Yield the flags on what is stated and on the shots themselves."""
    yield from _statements(dataset, shots)
    yield from _left_out(dataset, shots)
    yield from _excitation(dataset, shots)
    nominal_s = 1.0 / dataset.sample_rate_Hz
    gaps = sum((gaps_of(s.time_s, nominal_s, settings.gap) for s in dataset.shots), Gaps())
    yield from gaps.flags("The records have", nominal_s, "the fits do not mind")
    few = [s for s in shots if s.fit is not None and s.fit.cycles < settings.few_cycles]
    if few:
        least = min(few, key=lambda shot: shot.used_fit.cycles)
        cycles = least.used_fit.cycles
        yield Flag(
            "few-cycles",
            f"Fewer than {settings.few_cycles:g} cycles pass within the 1/e time in "
            f"{_names(few)}, the fewest in {least.name}, {cycles:.2f}; a larger field would be "
            "measured better.",
            details={"shots": [shot.name for shot in few], "cycles": cycles},
        )
    fits = [(shot, shot.used_fit) for shot in shots if shot.used]
    large = [s for s, fit in fits if abs(fit.baseline_V) > LARGE_BASELINE * fit.amplitude_V]
    if large:
        yield Flag(
            "baseline",
            f"The decaying baseline is larger than {LARGE_BASELINE:g} amplitudes of the tone "
            f"in {_names(large)}: the field lies near pump and probe.",
            details={"shots": [shot.name for shot in large]},
        )


def _statements(dataset: SerfDataset, shots: Sequence[ShotResult]) -> Iterator[Flag]:
    """Yield a flag for each stated number that nature or the rows' times deny."""
    bounds = GAMMA_HZ_PER_NT * (1.0 - GAMMA_MARGIN), GAMMA_HZ_PER_NT * (1.0 + GAMMA_MARGIN)
    look = "The slowing-down factor is as wrong as the statement. Correct gyromagnetic_ratio."
    gamma = Bounds("gyromagnetic_ratio", "The gyromagnetic ratio", *bounds, "Hz/nT", look)
    yield from implausible(dataset.gamma_Hz_per_nT, gamma)
    begun = [shot.used_fit.decay_per_s * shot.shot.time_s[0] for shot in shots if shot.used]
    look = "Time zero of t_s is where the field goes on and the pump light off: correct t_s."
    late = Bounds("t_s", "The time of the first row", -LATE, LATE, "1/e times of the tones", look)
    yield from implausible(float(np.median(begun or [0.0])), late)
    for shot in dataset.shots:
        steps = np.rint(np.diff(shot.time_s) * dataset.sample_rate_Hz)
        place = np.concatenate([[0.0], np.cumsum(steps)])
        slope, start = np.polyfit(place, shot.time_s, 1)
        uneven = np.max(np.abs(shot.time_s - start - slope * place)) * dataset.sample_rate_Hz
        margin = CLOCK_MARGIN + 3.0 * float(uneven / place[-1])
        look = (
            "The slowing-down factor is as uncertain. Find out which clock is right, and correct "
            "t_s or sample_rate."
        )
        name = f"The interval of the rows of {shot.name}"
        clock = Bounds("sample_rate", name, 1.0 - margin, 1.0 + margin, "nominal intervals", look)
        if denied := implausible(float(slope) * dataset.sample_rate_Hz, clock):
            yield from denied
            return


def _left_out(dataset: SerfDataset, shots: Sequence[ShotResult]) -> Iterator[Flag]:
    """Yield the flags of shots and samples that do not count."""
    if dataset.repeated:
        names = list(dict.fromkeys(name for name, _ in dataset.repeated))
        why = "; ".join(dict.fromkeys(reason for _, reason in dataset.repeated))
        text = f"Shots were taken again, the bad ones are left out: {', '.join(names)} ({why})."
        details = {"shots": names, "count": len(dataset.repeated)}
        yield Flag("shot-repeated", text, details=details)
    over = [shot for shot in shots if shot.saturated]
    if over:
        count = sum(shot.saturated for shot in over)
        text = f"{count} samples are saturated and left out, in {_names(over)}."
        details = {"count": count, "shots": [shot.name for shot in over]}
        yield Flag("overload", text, details=details)
    for shot in shots:
        if not shot.used:
            text = f"The shot {shot.name} is not used: {shot.rejected}."
            yield Flag("shot-rejected", text, details={"shot": shot.name})
    outliers = [int(np.sum(shot.usable & ~shot.kept)) if shot.used else 0 for shot in shots]
    if any(outliers):
        concerned = [shot for shot, count in zip(shots, outliers, strict=True) if count]
        yield Flag(
            "outliers-rejected",
            f"{sum(outliers)} samples stand more than six standard deviations from the fit and are "
            f"left out, in {_names(concerned)}.",
            details={"count": sum(outliers)},
        )


def _excitation(dataset: SerfDataset, shots: Sequence[ShotResult]) -> Iterator[Flag]:
    """Yield a flag for each coil whose field is not the commanded one, by the precession.

    Angles and residual field aside, the squares of the frequencies are sums of those of the coils.
    A coil that no shot with a tone drives, while others are seen, makes no field that turns the
    spins. What the slowing-down factor leaves open counts for the coil.
    """
    clear = [
        shot for shot in shots if shot.used and shot.used_fit.signal_to_noise >= MIN_SIGNAL_TO_NOISE
    ]
    if not clear or 2 * len(clear) < len(shots):
        return  # it is the light, or the cell
    square = np.array([shot.used_fit.omega_rad_per_s for shot in clear]) ** 2
    fields = np.array([shot.shot.field_nT**2 for shot in clear])
    of_coils = np.linalg.lstsq(fields, square, rcond=None)[0]
    if np.linalg.norm(square - fields @ of_coils) > UNEXPLAINED * np.linalg.norm(square):
        return  # the coils are not what makes these tones: that is reported of the shots
    measured = np.sqrt(np.maximum(of_coils, 0.0)) / dataset.gamma_rad_per_s_nT
    spin = SPINS[dataset.nuclear_spin]
    for k, axis in enumerate(AXES):
        driving = [shot for shot in shots if shot.shot.field_nT[k]]
        lost = not fields[:, k].any() and any(shot.saturated for shot in driving)
        if not driving or lost:
            continue
        per_nT = float(measured[k])
        share = min(max(1.0, spin.polarised * per_nT), spin.at_rest * per_nT)
        largest_nT = max(abs(float(shot.shot.field_nT[k])) for shot in driving)
        yield from excitation_flags(axis, axis, {axis: share}, (largest_nT, "nT"), axis)


def _names(shots: Sequence[ShotResult]) -> str:
    return ", ".join(shot.name for shot in shots)


def result_flags(
    dataset: SerfDataset,
    frequencies: Frequencies | None,
    results: Sequence[Estimate],
    wanting: dict[str, str],
    residual_nT: float | None,
    settings: AnalysisSettings,
) -> Iterator[Flag]:
    """Yield the flags on the solution: what it cannot determine and what stands against it.

    `wanting` says why the published rule has no angle of a pair.
    """
    yield from _not_identifiable(dataset, frequencies, results)
    for pair, why in wanting.items():
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
    yield from _unsteady(dataset, frequencies, settings)
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
    correlated = [
        lag_one
        for left in frequencies.residual_V
        if (lag_one := float(left[1:] @ left[:-1]) / (float(left @ left) or 1.0))
        > STIFF_U / np.sqrt(len(left))
    ]
    if max(correlated, default=0.0) > settings.model_too_stiff:
        yield too_stiff(max(correlated), " of a shot", "the fit does not follow the signal")
    slowing_down = next(result for result in results if result.name == SLOWING_DOWN)
    if outside_the_isotope(dataset, frequencies, slowing_down):
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


def _unsteady(
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
            f"The frequencies drift by {100.0 * drift:.2g} % per second during the records, "
            f"{abs(drift) / drift_u:.1f} u, beside what a fading polarisation does: the fields are "
            "not steady, or the recorder's clock is not. The slowing-down factor is off by more "
            "than its u; measure the coil currents during a record.",
            details={"drift_per_s": drift},
        )
    fading, fading_u = frequencies.fading
    if abs(fading) > FADING_U * fading_u:
        how = "faster" if fading > 0.0 else "more slowly"
        yield Flag(
            "misfit",
            f"The tone of the last shot fades {abs(100.0 * fading):.2g} % {how} than that of the "
            f"first, {abs(fading) / fading_u:.1f} u: the cell's temperature, the probe light or "
            "what leaks of the pump light was not steady. Wait until the cell is warm, and repeat "
            "the shots.",
            details={"fading": fading},
        )
    if frequencies.exchanged:
        yield contradiction(
            "pump_axis",
            f"The pump light is stated along {dataset.pump_axis} and the probe along "
            f"{dataset.probe_axis}, and the frequencies fall as if it were the other way round: "
            "correct pump_axis and probe_axis.",
        )
