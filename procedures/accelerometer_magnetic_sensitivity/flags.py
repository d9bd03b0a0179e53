"""What the reader must know about a dataset and its analysis, one flag a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.flags import excitation_flags, gaps_of
from station.findings import Estimate, Flag, combination_text

from .dataset import AccelerometerDataset, AnalysisSettings, LeftOut
from .model import COEFFICIENTS, Identifiability, describe, listed
from .nuisances import ARCSEC_PER_RAD
from .screening import COPIED, SATURATED, STUCK
from .solved import Jump, Solution

MAGNETIC = ("Km", "Kmm", "Kim", "Kom", "Kpm")
MOST_LISTED = 12
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def data_flags(
    dataset: AccelerometerDataset, left_out: Sequence[LeftOut], settings: AnalysisSettings
) -> list[Flag]:
    """Return the flags on the rows: overload, rejected ones, gaps, and the field that was made."""
    flags: list[Flag] = []
    overloaded = np.flatnonzero(dataset.overloaded)
    if len(overloaded):
        flags.append(
            Flag(
                "overload",
                f"The voltmeter was overloaded in {len(overloaded)} rows (the first is row "
                f"{overloaded[0]}, counted from 0); they are left out.",
                details={"count": len(overloaded), "rows": [int(row) for row in overloaded]},
            )
        )
    flags += _pattern_flags(dataset, left_out)
    known = (STUCK, COPIED, SATURATED)
    rejected = [
        one for one in left_out if not dataset.overloaded[one.row] and one.reason not in known
    ]
    if rejected:
        reasons = list(dict.fromkeys(one.reason for one in rejected))
        shown = ", ".join(str(one.row) for one in rejected[:MOST_LISTED])
        more = " and more" if len(rejected) > MOST_LISTED else ""
        flags.append(
            Flag(
                "outliers-rejected",
                f"{len(rejected)} of {len(dataset)} rows were left out ({'; '.join(reasons)}): "
                f"rows {shown}{more}, counted from 0.",
                details={"count": len(rejected), "rows": [one.row for one in rejected]},
            )
        )
    return flags + _gap(dataset, settings) + _field(dataset, left_out, settings)


def _pattern_flags(dataset: AccelerometerDataset, left_out: Sequence[LeftOut]) -> list[Flag]:
    """Return the flags of readings that stand still, are copies, or stand at a limit."""
    flags = []
    still = [one.row for one in left_out if one.reason == STUCK]
    if still:
        stuck_said = (
            f"Voltmeter or gaussmeter repeat their reading to the last digit in {len(still)} rows, "
            f"from row {still[0]} on, counted from 0, though the field changed; these rows are "
            "left out. Look at the instrument, its trigger and its cable."
        )
        what = "voltmeter or gaussmeter"
        details = {"count": len(still), "row": still[0], "what": what}
        flags.append(Flag("frozen", stuck_said, details=details))
    copies = [one.row for one in left_out if one.reason == COPIED]
    if copies:
        copied_said = (
            f"{len(copies)} rows, the first is row {copies[0]}, counted from 0, hold field and "
            "output of an earlier row to the last digit: they were not measured, and are left "
            "out. Look at what wrote the file."
        )
        details = {"count": len(copies), "row": copies[0]}
        flags.append(Flag("repeated-rows", copied_said, details=details))
    limit = [one.row for one in left_out if one.reason == SATURATED]
    if limit:
        limit_said = (
            f"The output stands at {dataset.output_V[limit[0]]:.6g} V in {len(limit)} rows, the "
            f"first is row {limit[0]}, counted from 0: voltmeter or device are at their limit, and "
            "these rows are left out. Take a higher range, or a smaller load resistor."
        )
        details = {"count": len(limit), "row": limit[0]}
        flags.append(Flag("saturated", limit_said, details=details))
    return flags


def _gap(dataset: AccelerometerDataset, settings: AnalysisSettings) -> list[Flag]:
    if not dataset.evenly_timed or len(dataset) < 3:
        return []
    steps_s = np.diff(dataset.time_s)
    nominal_s = float(np.median(steps_s))
    missing = int(np.sum(np.rint(steps_s / nominal_s) - 1.0))
    gaps = replace(gaps_of(dataset.time_s, nominal_s, settings.gap), missing=missing)
    return gaps.flags("The rows have", nominal_s, "the solution does not mind")


def _field(
    dataset: AccelerometerDataset, left_out: Sequence[LeftOut], settings: AnalysisSettings
) -> list[Flag]:
    good = np.ones(len(dataset), dtype=bool)
    good[[one.row for one in left_out]] = False
    commanded, measured = dataset.field_commanded_T[good], dataset.field_T[good]
    driven = commanded != 0.0
    if not bool(driven.any()):
        return []
    largest_T = float(np.max(np.abs(commanded)))
    levels = np.unique(commanded[driven])
    off = np.array([float(np.median(measured[commanded == one] - one)) for one in levels])
    wrong = _excitation(commanded, measured, largest_T)
    worst = int(np.argmax(np.abs(off)))
    part = float(off[worst]) / largest_T
    if abs(part) <= settings.field_differs_from_commanded:
        return wrong
    field_said = (
        f"Where {levels[worst]:.5g} T was commanded, {levels[worst] + off[worst]:.5g} T was "
        f"measured, off by {100.0 * part:+.3g} % of the largest field; the result uses the "
        "measured field."
    )
    details = {"relative_difference": part}
    return [*wrong, Flag("field-differs-from-commanded", field_said, details=details)]


def _excitation(commanded: Array, measured: Array, largest_T: float) -> list[Flag]:
    """Return the flag of a field that does not follow, by its change from end to end.

    A constant ambient field is no excitation; where only one level was commanded it stays in.
    """
    low, high = float(commanded.min()), float(commanded.max())
    change = float(np.median(measured[commanded == high]))
    if high > low:
        change -= float(np.median(measured[commanded == low]))
    share = change / (high - low or high)
    return excitation_flags("dc", "dc", {"dc": share}, (largest_T, "T"))


def jump_flags(dataset: AccelerometerDataset, rows: Sequence[int], jump: Jump) -> list[Flag]:
    """Return the flag of an encoder that is off in these rows of the dataset."""
    more_arcsec = -jump.angle_rad * ARCSEC_PER_RAD
    where, than = f"From row {rows[0]} on, counted from 0,", "before at the same angle"
    if not jump.lasts:
        where = f"In plane {dataset.plane[rows[0]]} at {dataset.theta_deg[rows[0]]:.5g} deg"
        than = "it should beside the other angles"
    return [
        Flag(
            "encoder-jump",
            f"{where} the encoder reads {more_arcsec:.4g} arcsec more than {than}; the solution "
            "corrects it. Look at the stage: it loses counts, or the accelerometer moved on it.",
            details={"row": rows[0], "rows": len(rows), "jump_arcsec": more_arcsec},
        )
    ]


def frozen_flags(frozen: Mask) -> list[Flag]:
    """Return the flag of a thermometer that stands still, by the rows in which it does."""
    rows = np.flatnonzero(frozen)
    if not len(rows):
        return []
    frozen_said = (
        f"The temperature repeats itself to the last digit in {len(rows)} rows, from row {rows[0]} "
        "on, counted from 0: the thermometer or its recorder stood still, or is too coarse to show "
        "a change. No reading of it is used, and what warmed the device counts as drift. Look at "
        "it, and write all its digits into the file."
    )
    details = {"count": len(rows), "row": int(rows[0]), "what": "thermometer"}
    return [Flag("frozen", frozen_said, details=details)]


def scale_drift_flags() -> list[Flag]:
    """Return the flag of a scale factor that drifted while no thermometer was read."""
    scale_said = (
        "The scale factor drifted, and no temperature says why: a term linear in time, of zero "
        "mean over the rows, was fitted and removed."
    )
    return [Flag("drift-removed", scale_said, details={"term": "Ki"})]


def residual_flags(solution: Solution, coarse_V: float) -> list[Flag]:
    """Return the flags of what groups of rows share, of noise that is not even, and of rounding.

    `coarse_V` is the step that the readings are multiples of.
    """
    flags = []
    if coarse_V > solution.noise_V:
        coarse_said = (
            f"The output has steps of {1e6 * coarse_V:.4g} µV, and the noise that is left is "
            f"{1e6 * solution.noise_V:.3g} µV: rounding decides the uncertainty. Take a lower "
            "range or a longer integration, and write all digits into the file."
        )
        flags.append(Flag("coarse-output", coarse_said, details={"step_V": coarse_V}))
    found, noise = solution.misfit, solution.uneven
    if found is not None:
        shared_said = (
            f"The rows of the same {found.what} are off together, most in {found.largest} by "
            f"{1e6 * found.size_V:+.3g} µV: the model does not follow the output there. The "
            f"uncertainties are {found.ratio**0.5:.2g} times larger for it. Look at the encoder, "
            "the mounting, and what is not linear."
        )
        details = {"what": found.what, "at": found.largest, "size_V": found.size_V}
        flags.append(Flag("misfit", shared_said, details=details))
    if noise is not None:
        sizes = ", ".join(f"{1e6 * one:.3g}" for one in noise.noise_V)
        where = "the planes in alphabetic order" if noise.what == "plane" else "thirds of the rows"
        noise_said = (
            f"The noise is not even: {sizes} µV in {where}. Each row weighs by its own. Look for "
            "what disturbed the noisy part: a loose cable, a motor, a range of the voltmeter."
        )
        noisy = {"by": noise.what, "noise_V": [float(one) for one in noise.noise_V]}
        flags.append(Flag("uneven-noise", noise_said, details=noisy))
    return flags


def moved_flags(found: Identifiability, measured: Identifiability) -> list[Flag]:
    """Return the flag of combinations that the measured field or angle moves from the commanded."""
    moved = [name for name, own in measured.terms.items() if own != found.terms[name]]
    if not moved:
        return []
    stand = ", ".join(combination_text(measured.terms[name], 6) for name in moved)
    moved_said = (
        f"The fields or angles that were measured are not those that were commanded, and move what "
        f"{listed(moved)} stand{'s' if len(moved) == 1 else ''} for: {stand}. The terms given are "
        "those of the measured ones."
    )
    return [Flag("field-differs-from-commanded", moved_said, details={"coefficients": moved})]


def result_flags(
    found: Identifiability,
    estimates: Sequence[Estimate],
    drift_order: int,
    lag_one: float | None,
    rows: int,
    settings: AnalysisSettings,
    as_planned: bool = True,
    measured: Identifiability | None = None,
) -> list[Flag]:
    """Return the flags on the solution: what it cannot tell, drift, what the model leaves."""
    flags: list[Flag] = []
    undetermined = [one.name for one in estimates if one.value is None]
    wanting = [n for n in COEFFICIENTS if n in found.not_alone or n in undetermined]
    if wanting:
        few = bool(set(undetermined) - set(found.folded))
        why = f"{rows} usable rows are too few." if few else " ".join(describe(measured or found))
        if few and not as_planned:
            why = (
                "The measured angles or fields do not follow the commanded ones: no value is given."
            )
        flags.append(
            Flag(
                "not-identifiable",
                f"Not every coefficient is determined alone. {why}",
                details={"coefficients": wanting},
            )
        )
    if drift_order:
        flags.append(
            Flag(
                "drift-removed",
                f"The output drifted; a polynomial in time of order {drift_order} with zero mean "
                "over the rows was fitted with the coefficients and removed.",
                details={"order": drift_order},
            )
        )
    if lag_one is not None and lag_one > settings.too_stiff_beyond(rows):
        flags.append(
            Flag(
                "model-too-stiff",
                f"Neighbouring residuals are correlated by {lag_one:.2f}: the model does not "
                "follow the output.",
                details={"lag_one_correlation": lag_one},
            )
        )
    weak = [
        one.name
        for one in estimates
        if one.name in MAGNETIC
        and one.value is not None
        and one.standard_uncertainty is not None
        and abs(one.value) < settings.not_significant * one.standard_uncertainty
    ]
    if weak:
        flags.append(
            Flag(
                "not-significant",
                f"{listed(weak)} cannot be told from zero: the magnitude is below "
                f"{settings.not_significant:g} standard uncertainties.",
                details={"coefficients": weak},
            )
        )
    return flags
