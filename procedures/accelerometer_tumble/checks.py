"""What is no reading, what the columns may mean instead, and the flags, one a sentence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import fdtri

from procedures.common.constants import ARCSEC_PER_RAD
from procedures.common.frozen import frozen_flag, repeated_windows
from procedures.estimation import channel
from procedures.estimation.flags import counted, not_identifiable, rows_listed, too_stiff
from procedures.estimation.folding import Terms
from procedures.estimation.orthogonal import independent_of
from procedures.estimation.plausibility import GRAVITY_G, OUTPUT_V, Bounds, implausible
from procedures.estimation.readings import Reading, Remainder, named, scaled, shifted, suiting
from procedures.estimation.saturation import at_a_limit
from station.findings import Estimate, Flag, combination_text, contradiction

from .dataset import STOPPED_FAR_DEG, AnalysisSettings, TumbleDataset
from .model import COEFFICIENTS, Array
from .solution import Solution, solve

MOVED_G = 0.01
"""By so much the acceleration changes before a reading that repeats is one of a dead meter."""
THERMOMETER = channel.Channel(
    "the temperature",
    "the thermometer",
    "degC",
    low=-80.0,
    high=150.0,
    harmless=0.5,
    slow=True,
    then="There are no temperature terms.",
)
GRAVITY = Bounds(
    "local_gravity", "The local gravity", *GRAVITY_G, "g", "Look at its value and its unit."
)
OUTPUT = Bounds(
    "output_V",
    "The largest output",
    -OUTPUT_V,
    OUTPUT_V,
    "V",
    "Look whether the column is in mV or another unit.",
)
ROWS_LATE = (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5)
OTHER_PLANE = {"io": "ip", "ip": "io"}
SMALLEST_PART = 1e-5
"""Of a column: with less of its own, readings determine other coefficients than those stated."""
BY_CHANCE = 1e-3
FEWEST_REPEATS = 5
FEWEST_NEIGHBOURS = 16
COARSE_G = 1e-3
"""Residuals of a good model scatter by micro-g; a milli-g is no noise."""


def screened(dataset: TumbleDataset) -> tuple[TumbleDataset, list[Flag]]:
    """Return the dataset without dead readings and those at a limit, and the flags of its columns.

    A thermometer with a reading that is none goes whole.
    """
    output, flags = dataset.output_V, []
    limited = at_a_limit(output)
    turned = np.abs(np.diff(dataset.columns[:, 1])) > MOVED_G
    still = turned & (np.diff(output) == 0.0) & ~limited[1:]
    dead = np.append(still, False) | np.append(False, still)
    dead = (dead | repeated_windows([output])[0]) & ~limited
    if rows := np.flatnonzero(dead).tolist():
        then = f"These are left out: {rows_listed(rows)}."
        details = {"count": len(rows), "instrument": "multimeter"}
        extent = counted(len(rows), "row")
        flags.append(frozen_flag("The output", extent, "the multimeter", then, details))
    used = dataset
    if dataset.temperature_degC is not None:
        handled = np.append(False, np.diff(dataset.mounting) != 0)
        paused = channel.after_a_pause(dataset.time_s)
        warm = channel.screen(THERMOMETER, dataset.temperature_degC, free=handled, paused=paused)
        flags += channel.flags([warm])
        used = dataset if warm.good.all() else replace(dataset, temperature_degC=None)
    if rows := np.flatnonzero(limited).tolist():
        limit_text = (
            f"Saturated: the output stands at its largest value in {rows_listed(rows)}; these "
            "are left out. Look at the range of the multimeter and at that of the accelerometer."
        )
        flags.append(Flag("overload", limit_text, None, {"count": len(rows)}))
    flags += implausible(dataset.gravity_g, GRAVITY)
    if len(output):
        flags += implausible(float(output[np.argmax(np.abs(output))]), OUTPUT)
    if rows := np.flatnonzero(dataset.far).tolist():
        far_text = (
            f"The encoder is more than {STOPPED_FAR_DEG:g} deg from the commanded angle in "
            f"{rows_listed(rows)}; where the output does not follow it, the reading is left out."
        )
        flags.append(contradiction("commanded_deg", far_text, None, count=len(rows)))
    return used.only(~dead & ~limited), flags


def misread_flags(
    dataset: TumbleDataset, kept: tuple[str, ...], solution: Solution, settings: AnalysisSettings
) -> list[Flag]:
    """Return the flag of what the columns mean where they do not mean what is stated, or none.

    Looked for where something beside the model moved the output.
    """
    if solution.cause is None:
        return []
    places = [COEFFICIENTS.index(name) for name in kept]
    nothing = np.empty((len(dataset.time_s), 0))

    def remainder(data: TumbleDataset) -> Remainder | None:
        if len(independent_of(nothing, data.columns[:, places], SMALLEST_PART)) < len(places):
            return None
        solved = solve(data, kept, settings, beside=False)
        # Readings left out are what a model does not follow.
        residual = np.abs(solved.residual_V)
        squares = float(np.sum(np.minimum(residual, np.quantile(residual, 0.98)) ** 2))
        return Remainder(squares, solved.freedom)

    suits = suiting(dataset, _readings(dataset), remainder)
    if not suits:
        return []
    text = (
        f"The output is followed only if {named(suits)}. There are no results: mend the table, "
        "and analyse it again."
    )
    return [suits[0].reading.flag(text)]


def _readings(dataset: TumbleDataset) -> list[Sequence[Reading[TumbleDataset]]]:
    """Return what laboratories mix up: rows of the output; plane, reversal, head of a mounting."""
    late = [
        Reading(
            f"the outputs stand {rows} row(s) too late"
            if rows > 0
            else f"the outputs stand {-rows} row(s) too early",
            shifted(("output_V",), rows),
            "output_V",
            {"rows": rows},
        )
        for rows in ROWS_LATE
    ]
    called = [
        Reading(
            f"mounting {number + 1} in order of time has another `{column}`",
            partial(change, number),
            column,
            {"mounting": number + 1},
        )
        for number in range(int(dataset.mounting[-1]) + 1)
        for column, change in CALLED_OTHERWISE.items()
    ]
    heads = [
        Reading("`head_deg` is of the other sense", scaled(("head_rad",), -1.0), "head_deg"),
        Reading("`theta_deg` holds `head_deg` already", scaled(("head_rad",), 0.0), "head_deg"),
    ]
    return [late, called, heads if dataset.head_rad.any() else []]


def _in_other_plane(number: int, dataset: TumbleDataset) -> TumbleDataset:
    other = np.array([OTHER_PLANE[name] for name in dataset.plane.tolist()])
    return replace(dataset, plane=np.where(dataset.mounting == number, other, dataset.plane))


def _reversed(number: int, dataset: TumbleDataset) -> TumbleDataset:
    there = dataset.mounting == number
    return replace(dataset, reverse=np.where(there, -dataset.reverse, dataset.reverse))


CALLED_OTHERWISE: dict[str, Callable[[int, TumbleDataset], TumbleDataset]] = {
    "plane": _in_other_plane,
    "reversed": _reversed,
}


def fold_flags(terms: Terms, without: Sequence[str]) -> list[Flag]:
    """Return the flag of coefficients that the mountings and positions do not determine alone.

    `without` are the angles and ratios that have no value for it.
    """
    alone = {name for name, own in terms.items() if len(own) == 1}
    lost = [name for name in COEFFICIENTS if name not in alone]
    if not lost:
        return []
    together = [combination_text(own) for own in terms.values() if len(own) > 1]
    held = {name for own in terms.values() for name in own}
    never = [name for name in COEFFICIENTS if name not in held]
    fold_text = "The mountings and positions do not determine every coefficient alone."
    fold_text += f" Only together: {', '.join(together)}." if together else ""
    fold_text += f" Not at all: {', '.join(never)}." if never else ""
    return [not_identifiable(fold_text, [*lost, *without])]


def result_flags(
    dataset: TumbleDataset,
    solution: Solution,
    estimates: Sequence[Estimate],
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the solution."""
    flags = []
    if wild := np.flatnonzero(~solution.kept).tolist():
        wild_text = f"Left out as wild: {rows_listed(wild)} of the readings that are not frozen."
        flags.append(Flag("outliers-rejected", wild_text, None, {"count": len(wild)}))
    if slow := list(solution.slow):
        size = float(np.ptp(solution.slow_V))
        drift_text = f"Drift of {size:.2g} V is solved for: {', '.join(slow)}."
        flags.append(Flag("drift-removed", drift_text, None, {"terms": slow}))
    if (cause := solution.cause) is not None:
        row = {} if cause.row is None else {"time_s": float(dataset.time_s[cause.row])}
        if cause.code == "output-step" and cause.unit == "V":
            row["step_V"] = float(solution.cause_terms[0])
        flags.append(cause.flag(solution.cause_terms, row))
    if (scale := solution.of("Ki")) < 0.0:
        sign_text = (
            f"The scale factor is negative, {scale:.6g} V/g: look at the leads of the output and "
            "at the sense of rotation of theta."
        )
        flags.append(contradiction("theta_deg", sign_text))
    flags += _nuisances(solution, settings) + _misfit(dataset, solution, settings)
    small = [
        estimate.name
        for estimate in estimates
        if estimate.axis is None
        and estimate.value is not None
        and estimate.standard_uncertainty is not None
        and abs(estimate.value) < settings.not_significant * estimate.standard_uncertainty
    ]
    if small:
        small_text = (
            f"Below {settings.not_significant:g} standard uncertainties: {', '.join(small)}."
        )
        flags.append(Flag("not-significant", small_text, None, {"coefficients": small}))
    return flags


def _nuisances(solution: Solution, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags of encoder and mountings that are worse than stated."""
    flags = []
    priors = solution.priors
    expected = np.where(solution.beside_u > 0.0, solution.beside_u, np.inf)
    size = np.abs(solution.beside) / expected
    for statement, rows in (
        ("encoder_accuracy", priors.encoder),
        ("mounting_repeatability", ~priors.encoder),
    ):
        own = np.where(rows, size, 0.0)
        if float(own.max(initial=0.0)) <= settings.nuisance:
            continue
        worst = int(np.argmax(own))
        angle = float(solution.beside[worst]) * ARCSEC_PER_RAD
        stated = float(priors.prior_rad[worst]) * ARCSEC_PER_RAD
        number = worst - int(priors.encoder.sum()) + 1
        which = f"Mounting {number} in order of time" if number > 0 else "A harmonic of the encoder"
        angle_text = (
            f"{which} is off by {angle:.3g} arcsec where {stated:.3g} arcsec are stated: look at "
            "plane, reversal and head of each mounting; otherwise u is too small."
        )
        flags.append(contradiction(statement, angle_text, None, angle_arcsec=angle))
    return flags


def _misfit(dataset: TumbleDataset, solution: Solution, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags of residuals that are no noise."""
    rest = solution.residual_V[solution.kept]
    if solution.sigma_V > COARSE_G * abs(solution.of("Ki")):
        scatter_text = (
            f"The residuals scatter by {solution.sigma_V:.2g} V: the model does not follow the "
            "output. Look at the angles, at the sense of rotation and at plane and reversal."
        )
        return [Flag("misfit", scatter_text, None, {"residual_V": solution.sigma_V})]
    place = np.round(np.rad2deg(dataset.commanded_rad[solution.kept]) % 360.0, 3)
    keys = np.column_stack((dataset.mounting[solution.kept], place))
    _, index = np.unique(keys, axis=0, return_inverse=True)
    ratio = _between(rest, index.ravel(), solution.freedom)
    flags = []
    if ratio is not None:
        repeat_text = (
            f"Readings at one position agree {ratio:.2g} times better than the model follows the "
            "positions: an angle or a higher harmonic is not in the model, and u is too small."
        )
        flags.append(Flag("misfit", repeat_text, None, {"ratio": ratio}))
    if len(rest) >= FEWEST_NEIGHBOURS:
        lag = float(rest[1:] @ rest[:-1] / max(float(rest @ rest), 1e-300))
        if lag > max(settings.model_too_stiff, 4.0 / np.sqrt(len(rest))):
            flags.append(too_stiff(lag))
    return flags


def _between(rest: Array, index: np.ndarray, freedom: float) -> float | None:
    """Return the root of the variance between positions over that within, where it is no chance."""
    count = np.bincount(index)
    within = len(rest) - len(count)
    between = freedom - within
    if within < FEWEST_REPEATS or between < FEWEST_REPEATS:
        return None
    mean = np.bincount(index, rest) / count
    inner = float(np.sum((rest - mean[index]) ** 2)) / within
    outer = float(count @ mean**2) / between
    if outer <= inner * float(fdtri(between, within, 1.0 - BY_CHANCE)):
        return None
    return float(np.sqrt(outer / max(inner, 1e-300)))
