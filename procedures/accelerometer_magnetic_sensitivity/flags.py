"""What the reader must know about a dataset and its analysis, one flag a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate, Flag

from .dataset import AccelerometerDataset
from .findings import AnalysisSettings, LeftOut
from .identifiability import Identifiability, describe, listed
from .jump import Jump
from .model import COEFFICIENTS
from .nuisances import ARCSEC_PER_RAD
from .solved import Cause, Solution

MAGNETIC = ("Km", "Kmm", "Kim", "Kom", "Kpm")
MOST_LISTED = 12
STEP_KEYS = {"V": "step_V", "V/g": "step_V_per_g", "V/T": "step_V_per_T"}
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
    rejected = [one for one in left_out if not dataset.overloaded[one.row]]
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


def _gap(dataset: AccelerometerDataset, settings: AnalysisSettings) -> list[Flag]:
    if not dataset.evenly_timed or len(dataset) < 3:
        return []
    steps_s = np.diff(dataset.time_s)
    nominal_s = float(np.median(steps_s))
    gaps = int(np.sum(steps_s > settings.gap * nominal_s))
    if not gaps:
        return []
    longest_s = float(steps_s.max())
    missing = int(np.sum(np.rint(steps_s / nominal_s) - 1.0))
    gaps_said = (
        f"The rows have {gaps} gap{'s' if gaps > 1 else ''}, the longest {longest_s:g} s for a "
        f"nominal interval of {nominal_s:g} s; the solution does not mind."
    )
    details = {"count": gaps, "missing_samples": missing, "longest_s": longest_s}
    return [Flag("gap", gaps_said, details=details)]


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
    worst = int(np.argmax(np.abs(off)))
    part = float(off[worst]) / largest_T
    if abs(part) <= settings.field_differs_from_commanded:
        return []
    field_said = (
        f"Where {levels[worst]:.5g} T was commanded, {levels[worst] + off[worst]:.5g} T was "
        f"measured, off by {100.0 * part:+.2g} % of the largest field; the result uses the "
        "measured field."
    )
    details = {"relative_difference": part}
    return [Flag("field-differs-from-commanded", field_said, details=details)]


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
        "on, counted from 0: the thermometer or its recorder stood still. No reading of it is "
        "used, and what warmed the device counts as drift."
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


def cause_flags(solution: Solution, rows: NDArray[np.int64]) -> list[Flag]:
    """Return the flag of what moved the output beside the model; `rows` are those of the dataset.

    Its size is the largest change of the output that it makes over the rows.
    """
    cause = solution.cause
    if cause is None:
        return []
    places = [solution.names.index(name) for name in cause.names]
    terms = solution.coefficients[places]
    course_V = np.einsum("ij,j->i", cause.columns, terms)
    size_V = float(np.ptp(course_V))
    details: dict[str, object] = {"what": cause.what, "size_V": size_V}
    size = f"{1e6 * size_V:.3g} µV"
    if cause.code == "hysteresis":
        moved = {
            "bias": "the output differs by where the field came from",
            "scale": "the scale factor differs by where the field came from",
            "last field": "the output still holds a part of the field of the row before",
        }[cause.what]
        hysteresis_said = (
            f"Hysteresis: {moved}, by up to {size}; it is fitted and removed. A core or a torquer "
            "keeps a part of its magnetisation, or the field had not settled: degauss before each "
            "point, wait longer, and compare field up with field down."
        )
        return [Flag("hysteresis", hysteresis_said, details=details)]
    if cause.code == "not-settled":
        part = float(terms[0])
        settled_said = (
            f"Each output holds {100.0 * part:.2g} % of the one before: it was read before it had "
            "settled, or stands in the wrong row. The solution corrects a small part. Lengthen "
            "the dwell, and look at the filter of the voltmeter and at the rows."
        )
        return [Flag("not-settled", settled_said, details={"part": part})]
    if cause.code == "field-differs-from-commanded":
        field_said = (
            f"The output follows the commanded field, not the gaussmeter, by {float(terms[0]):.2f} "
            f"of their difference (up to {size}); the solution corrects that. Look at the "
            "gaussmeter: its range, zero, cable and place, and whether its column is shifted."
        )
        return [Flag("field-differs-from-commanded", field_said, details=details)]
    if cause.code == "periodic":
        line_said = (
            f"The output has a line with a period of {cause.what} and a range of {size}, which is "
            "fitted and removed: mains pick-up or another disturbance, aliased by the interval "
            "of the rows. Look at grounding, shields and the integration time of the voltmeter."
        )
        return [Flag("periodic", line_said, details=details)]
    if cause.code == "drift-removed":
        drift_said = (
            f"{cause.what} drifted in the course of the rows (up to {size} of the output), and no "
            "temperature says why; terms of zero mean were fitted and removed. Look at the "
            "thermometer's place, and warm the device up for longer."
        )
        return [Flag("drift-removed", drift_said, details={"term": cause.what})]
    if cause.code == "misfit":
        misfit_said = (
            f"The output has a shape that the model does not have, by {cause.what} (up to {size}); "
            "one term for it is fitted, and what it leaves is not known. Look for a saturated "
            "core, a voltmeter that is not linear, and an encoder's scale."
        )
        return [Flag("misfit", misfit_said, details=details)]
    return step_flags(cause, float(terms[0]), rows)


def step_flags(cause: Cause, size: float, rows: NDArray[np.int64]) -> list[Flag]:
    """Return the flag of an output, or a gain, that steps at a row or is another in a plane."""
    more = f"{1e6 * size:+.4g} µ{cause.unit}"
    where, than = f"In {cause.what.removeprefix('gain of ')}", "in the others"
    details: dict[str, object] = {STEP_KEYS[cause.unit]: size}
    if cause.row is not None:
        row = int(rows[cause.row])
        where, than = f"From row {row} on, counted from 0,", "before"
        details["row"] = row
    step_said = (
        f"{where} the output reads {more} more than {than} at the same angle and field; the "
        "solution takes the step for one of the output and removes it, K0 and Ki being the mean. "
        "Look at the voltmeter, its range and input, and the device."
    )
    return [Flag("output-step", step_said, details=details)]


def residual_flags(solution: Solution) -> list[Flag]:
    """Return the flags of what groups of rows share, and of noise that is not even."""
    flags = []
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


def result_flags(
    found: Identifiability,
    estimates: Sequence[Estimate],
    drift_order: int,
    lag_one: float | None,
    rows: int,
    settings: AnalysisSettings,
    as_planned: bool = True,
) -> list[Flag]:
    """Return the flags on the solution: what it cannot tell, drift, what the model leaves."""
    flags: list[Flag] = []
    undetermined = [one.name for one in estimates if one.value is None]
    wanting = [n for n in COEFFICIENTS if n in found.not_alone or n in undetermined]
    if wanting:
        few = bool(set(undetermined) - set(found.folded))
        why = f"{rows} usable rows are too few." if few else " ".join(describe(found))
        if few and not as_planned:
            why = "The measured angles or fields do not follow the commanded ones: nothing is told."
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
