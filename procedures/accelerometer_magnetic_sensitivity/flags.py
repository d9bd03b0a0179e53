"""What the reader must know about a dataset and its analysis, one flag a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.flags import (
    MAX_LISTED,
    excitation_flags,
    frozen,
    gaps_of,
    not_identifiable,
    too_stiff,
)
from station.findings import Estimate, Flag, combination_text

from .dataset import AccelerometerDataset, LeftOut
from .model import COEFFICIENTS, Identifiability, describe, listed
from .nuisances import ARCSEC_PER_RAD
from .parameters import AnalysisSettings
from .screening import COPIED, HELD, SATURATED, STUCK
from .solved import Jump, Solution

MAGNETIC = ("Km", "Kmm", "Kim", "Kom", "Kpm")
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


SCALE_DRIFT = Flag(
    "drift-removed",
    "The scale factor drifted, and no temperature says why: a term linear in time, of zero mean "
    "over the rows, was fitted and removed.",
    details={"term": "Ki"},
)


def data_flags(
    dataset: AccelerometerDataset, left_out: Sequence[LeftOut], settings: AnalysisSettings
) -> Iterator[Flag]:
    """Yield the flags on the rows: overload, rejected ones, gaps, and the field that was made."""
    overloaded = np.flatnonzero(dataset.overloaded)
    if len(overloaded):
        yield Flag(
            "overload",
            f"The voltmeter was overloaded in {len(overloaded)} rows (the first is row "
            f"{overloaded[0]}, counted from 0); they are left out.",
            details={"count": len(overloaded), "rows": [int(row) for row in overloaded]},
        )
    yield from _pattern_flags(dataset, left_out)
    known = (STUCK, HELD, COPIED, SATURATED)
    rejected = [
        left for left in left_out if not dataset.overloaded[left.row] and left.reason not in known
    ]
    if rejected:
        reasons = list(dict.fromkeys(left.reason for left in rejected))
        shown = ", ".join(str(left.row) for left in rejected[:MAX_LISTED])
        more = " and more" if len(rejected) > MAX_LISTED else ""
        yield Flag(
            "outliers-rejected",
            f"{len(rejected)} of {len(dataset)} rows were left out ({'; '.join(reasons)}): "
            f"rows {shown}{more}, counted from 0.",
            details={"count": len(rejected), "rows": [left.row for left in rejected]},
        )
    if dataset.evenly_timed and len(dataset) > 2:
        steps_s = np.diff(dataset.time_s)
        nominal_s = float(np.median(steps_s))
        missing = int(np.sum(np.rint(steps_s / nominal_s) - 1.0))
        gaps = replace(gaps_of(dataset.time_s, nominal_s, settings.gap), missing=missing)
        yield from gaps.flags("The rows have", nominal_s, "the solution does not mind")
    good = np.ones(len(dataset), dtype=bool)
    good[[left.row for left in left_out]] = False
    yield from _field_flags(dataset.field_commanded_T[good], dataset.field_T[good], settings)


def _pattern_flags(dataset: AccelerometerDataset, left_out: Sequence[LeftOut]) -> Iterator[Flag]:
    """Yield the flags of readings that stand still, are copies, or stand at a limit."""
    still, held, copies, limit = (
        [left.row for left in left_out if left.reason == reason]
        for reason in (STUCK, HELD, COPIED, SATURATED)
    )
    if still:
        yield frozen(
            "The reading of voltmeter or gaussmeter",
            _from_row(still),
            "the instrument",
            "These rows are left out. Look at the instrument, its trigger and its cable.",
            {"count": len(still), "row": still[0], "what": "voltmeter or gaussmeter"},
            though=", though the field changed",
        )
    if held:
        yield frozen(
            "The angle",
            _from_row(held),
            "the encoder",
            "These rows are left out. Look at the encoder, its cable and what writes theta_deg.",
            {"count": len(held), "row": held[0], "what": "encoder"},
            though=", while the output moves as with the angle",
        )
    if copies:
        yield Flag(
            "repeated-rows",
            f"{len(copies)} rows, the first is row {copies[0]}, counted from 0, hold field and "
            "output of an earlier row to the last digit: they were not measured, and are left "
            "out. Look at what wrote the file.",
            details={"count": len(copies), "row": copies[0]},
        )
    if limit:
        yield Flag(
            "saturated",
            f"The output stands at {dataset.output_V[limit[0]]:.6g} V in {len(limit)} rows, the "
            f"first is row {limit[0]}, counted from 0: voltmeter or device are at their limit, and "
            "these rows are left out. Take a higher range, or a smaller load resistor.",
            details={"count": len(limit), "row": limit[0]},
        )


def _field_flags(commanded: Array, measured: Array, settings: AnalysisSettings) -> Iterator[Flag]:
    """Yield the flags of a field that does not follow its command: end to end, and by level.

    A constant ambient field is no excitation; where only one level was commanded it stays in.
    """
    driven = commanded != 0.0
    if not bool(driven.any()):
        return
    low, high = float(commanded.min()), float(commanded.max())
    change = float(np.median(measured[commanded == high]))
    if high > low:
        change -= float(np.median(measured[commanded == low]))
    largest_T = float(np.max(np.abs(commanded)))
    share = change / (high - low or high)
    yield from excitation_flags("dc", "dc", {"dc": share}, (largest_T, "T"))
    levels = np.unique(commanded[driven])
    off = np.array([float(np.median(measured[commanded == level] - level)) for level in levels])
    worst = int(np.argmax(np.abs(off)))
    part = float(off[worst]) / largest_T
    if abs(part) > settings.field_differs_from_commanded:
        yield Flag(
            "field-differs-from-commanded",
            f"Where {levels[worst]:.5g} T was commanded, {levels[worst] + off[worst]:.5g} T was "
            f"measured, off by {100.0 * part:+.3g} % of the largest field; the result uses the "
            "measured field.",
            details={"relative_difference": part},
        )


def jump_flag(dataset: AccelerometerDataset, rows: Sequence[int], jump: Jump) -> Flag:
    """Return the flag of an encoder that is off in these rows of the dataset."""
    more_arcsec = -jump.angle_rad * ARCSEC_PER_RAD
    where, than = f"From row {rows[0]} on, counted from 0,", "before at the same angle"
    if not jump.lasts:
        where = f"In plane {dataset.plane[rows[0]]} at {dataset.theta_deg[rows[0]]:.5g} deg"
        than = "it should beside the other angles"
    return Flag(
        "encoder-jump",
        f"{where} the encoder reads {more_arcsec:.4g} arcsec more than {than}; the solution "
        "corrects it. Look at the stage: it loses counts, or the accelerometer moved on it.",
        details={"row": rows[0], "rows": len(rows), "jump_arcsec": more_arcsec},
    )


def frozen_flags(repeated: Mask) -> Iterator[Flag]:
    """Yield the flag of a thermometer that stands still, by the rows in which it does."""
    rows = [int(row) for row in np.flatnonzero(repeated)]
    if rows:
        yield frozen(
            "The temperature",
            _from_row(rows),
            "the thermometer",
            "No reading of it is used, and what warmed the device counts as drift. One that is too "
            "coarse to show a change looks alike: write all its digits into the file.",
            {"count": len(rows), "row": rows[0], "what": "thermometer"},
        )


def _from_row(rows: Sequence[int]) -> str:
    return f"{len(rows)} rows, from row {rows[0]} on, counted from 0"


def residual_flags(solution: Solution, coarse_V: float) -> Iterator[Flag]:
    """Yield the flags of what groups of rows share, of noise that is not even, and of rounding.

    `coarse_V` is the step that the readings are multiples of.
    """
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


def moved_flags(planned: Identifiability, measured: Identifiability) -> Iterator[Flag]:
    """Yield the flag of combinations that the measured field or angle moves from the commanded."""
    moved = [name for name, own in measured.terms.items() if own != planned.terms[name]]
    if moved:
        combinations = ", ".join(combination_text(measured.terms[name], 6) for name in moved)
        yield Flag(
            "field-differs-from-commanded",
            "The fields or angles that were measured are not those that were commanded, and move "
            f"what {listed(moved)} stand{'s' if len(moved) == 1 else ''} for: {combinations}. The "
            "terms given are those of the measured ones.",
            details={"coefficients": moved},
        )


def result_flags(
    planned: Identifiability,
    estimates: Sequence[Estimate],
    drift_order: int,
    lag_one: float | None,
    rows: int,
    settings: AnalysisSettings,
    as_planned: bool = True,
    measured: Identifiability | None = None,
) -> Iterator[Flag]:
    """Yield the flags on the solution: what it cannot determine, drift, what the model leaves."""
    undetermined = [estimate.name for estimate in estimates if estimate.value is None]
    wanting = [n for n in COEFFICIENTS if n in planned.not_alone or n in undetermined]
    if wanting:
        why = " ".join(describe(measured or planned))
        if set(undetermined) - set(planned.folded):
            why = f"{rows} usable rows are too few."
            if not as_planned:
                why = (
                    "The measured angles or fields do not follow the commanded ones: no value is "
                    "given."
                )
        yield not_identifiable(f"Not every coefficient is determined alone. {why}", wanting)
    if drift_order:
        yield Flag(
            "drift-removed",
            f"The output drifted; a polynomial in time of order {drift_order} with zero mean "
            "over the rows was fitted with the coefficients and removed.",
            details={"order": drift_order},
        )
    if lag_one is not None and lag_one > settings.too_stiff_beyond(rows):
        yield too_stiff(lag_one)
    weak = [
        estimate.name
        for estimate in estimates
        if estimate.name in MAGNETIC
        and estimate.value is not None
        and estimate.standard_uncertainty is not None
        and abs(estimate.value) < settings.not_significant * estimate.standard_uncertainty
    ]
    if weak:
        yield Flag(
            "not-significant",
            f"{listed(weak)} cannot be distinguished from zero: the magnitude is below "
            f"{settings.not_significant:g} standard uncertainties.",
            details={"coefficients": weak},
        )
