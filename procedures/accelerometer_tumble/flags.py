"""What the reader must know about a tumble test, one flag a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtri

from procedures.estimation.flags import counted, frozen, not_identifiable, rows_listed, too_stiff
from procedures.estimation.folding import Terms
from procedures.estimation.plausibility import GRAVITY_G, OUTPUT_V, Bounds, implausible
from station.findings import Estimate, Flag, combination_text, contradiction

from .dataset import AnalysisSettings, TumbleDataset
from .model import COEFFICIENTS, Array
from .screening import Screened
from .solution import Solution

BY_CHANCE = 1e-3
FEWEST_REPEATS = 5
FEWEST_NEIGHBOURS = 16
STOPPED_FAR_RAD = np.deg2rad(1.0)
COARSE_G = 1e-3
"""Residuals of a good model scatter by micro-g; a milli-g is no noise."""
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
ARCSEC = 3600.0 * 180.0 / np.pi


def data_flags(whole: TumbleDataset, screened: Screened) -> list[Flag]:
    """Return the flags on the readings as they were recorded."""
    flags = []
    if dead := np.flatnonzero(screened.dead).tolist():
        then = f"These are left out: {rows_listed(dead)}."
        details = {"count": len(dead), "instrument": "multimeter"}
        extent = counted(len(dead), "row")
        flags.append(frozen("The output", extent, "the multimeter", then, details))
    flags += screened.warm_flags
    if limited := np.flatnonzero(screened.limited).tolist():
        said = (
            f"Saturated: the output stands at its largest value in {rows_listed(limited)}; these "
            "are left out. Look at the range of the multimeter and at that of the accelerometer."
        )
        flags.append(Flag("overload", said, None, {"count": len(limited)}))
    flags += implausible(whole.gravity_g, GRAVITY)
    if len(whole.output_V):
        flags += implausible(float(whole.output_V[np.argmax(np.abs(whole.output_V))]), OUTPUT)
    off = np.angle(np.exp(1j * (whole.encoder_rad - whole.commanded_rad)))
    if far := np.flatnonzero(np.abs(off) > STOPPED_FAR_RAD).tolist():
        said = (
            f"The encoder is more than 1 deg from the commanded angle in {rows_listed(far)}; "
            "where the output does not follow it, the reading is left out."
        )
        flags.append(contradiction("commanded_deg", said, None, count=len(far)))
    return flags


def fold_flags(terms: Terms) -> list[Flag]:
    """Return the flag of coefficients that the mountings and positions do not determine alone."""
    alone = {name for name, own in terms.items() if len(own) == 1}
    lost = [name for name in COEFFICIENTS if name not in alone]
    if not lost:
        return []
    together = [combination_text(own) for own in terms.values() if len(own) > 1]
    held = {name for own in terms.values() for name in own}
    never = [name for name in COEFFICIENTS if name not in held]
    said = "The mountings and positions do not determine every coefficient alone."
    said += f" Only together: {', '.join(together)}." if together else ""
    said += f" Not at all: {', '.join(never)}." if never else ""
    return [not_identifiable(said, lost)]


def result_flags(
    dataset: TumbleDataset,
    solution: Solution,
    estimates: Sequence[Estimate],
    scale: float,
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the solution."""
    flags = []
    if wild := np.flatnonzero(~solution.kept).tolist():
        said = f"Left out as wild: {rows_listed(wild)} of the readings that are not frozen."
        flags.append(Flag("outliers-rejected", said, None, {"count": len(wild)}))
    if solution.slow_names:
        size = float(np.ptp(solution.slow_V))
        said = f"Drift of {size:.2g} V is solved for: {', '.join(solution.slow_names)}."
        flags.append(Flag("drift-removed", said, None, {"terms": list(solution.slow_names)}))
    if (cause := solution.cause) is not None:
        row = {} if cause.row is None else {"time_s": float(dataset.time_s[cause.row])}
        if cause.code == "output-step" and cause.unit == "V":
            row["step_V"] = float(solution.cause_terms[0])
        flags.append(cause.flag(solution.cause_terms, row))
    if scale < 0.0:
        said = (
            f"The scale factor is negative, {scale:.6g} V/g: look at the leads of the output and "
            "at the sense of rotation of theta."
        )
        flags.append(contradiction("theta_deg", said))
    flags += _nuisances(solution, settings) + _misfit(dataset, solution, scale, settings)
    small = [
        estimate.name
        for estimate in estimates
        if estimate.axis is None
        and estimate.value is not None
        and estimate.standard_uncertainty is not None
        and abs(estimate.value) < settings.not_significant * estimate.standard_uncertainty
    ]
    if small:
        said = f"Below {settings.not_significant:g} standard uncertainties: {', '.join(small)}."
        flags.append(Flag("not-significant", said, None, {"coefficients": small}))
    return flags


def _nuisances(solution: Solution, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags of encoder and mountings that are worse than stated."""
    flags = []
    expected = np.where(solution.beside_u > 0.0, solution.beside_u, np.inf)
    size = np.abs(solution.beside) / expected
    for statement, rows in (
        ("encoder_accuracy", solution.priors.encoder),
        ("mounting_repeatability", ~solution.priors.encoder),
    ):
        own = np.where(rows, size, 0.0)
        if not len(own) or float(own.max()) <= settings.nuisance:
            continue
        worst = int(np.argmax(own))
        angle = float(solution.beside[worst]) * ARCSEC
        stated = float(solution.priors.prior_rad[worst]) * ARCSEC
        which = "A harmonic of the encoder"
        if statement == "mounting_repeatability":
            which = f"Mounting {worst - int(solution.priors.encoder.sum()) + 1} in order of time"
        said = (
            f"{which} is off by {angle:.3g} arcsec where {stated:.3g} arcsec are stated: look at "
            "plane, reversal and head of each mounting; otherwise u is too small."
        )
        flags.append(contradiction(statement, said, None, angle_arcsec=angle))
    return flags


def _misfit(
    dataset: TumbleDataset, solution: Solution, scale: float, settings: AnalysisSettings
) -> list[Flag]:
    left = solution.residual_V[solution.kept]
    if solution.sigma_V > COARSE_G * abs(scale):
        said = (
            f"The residuals scatter by {solution.sigma_V:.2g} V: the model does not follow the "
            "output. Look at the angles, at the sense of rotation and at plane and reversal."
        )
        return [Flag("misfit", said, None, {"residual_V": solution.sigma_V})]
    place = np.round(np.rad2deg(dataset.commanded_rad[solution.kept]) % 360.0, 3)
    keys = np.column_stack((dataset.mounting[solution.kept], place))
    _, index = np.unique(keys, axis=0, return_inverse=True)
    ratio = _between(left, index.ravel(), solution.freedom)
    flags = []
    if ratio is not None:
        said = (
            f"Readings at one position agree {ratio:.2g} times better than the model follows the "
            "positions: an angle or a higher harmonic is not in the model, and u is too small."
        )
        flags.append(Flag("misfit", said, None, {"ratio": ratio}))
    if len(left) >= FEWEST_NEIGHBOURS:
        lag = float(left[1:] @ left[:-1] / max(float(left @ left), 1e-300))
        if lag > max(settings.model_too_stiff, 4.0 / np.sqrt(len(left))):
            flags.append(too_stiff(lag))
    return flags


def _between(left: Array, index: np.ndarray, freedom: float) -> float | None:
    """Return the root of the variance between positions over that within, where it is no chance."""
    count = np.bincount(index)
    within = len(left) - len(count)
    between = freedom - within
    if within < FEWEST_REPEATS or between < FEWEST_REPEATS:
        return None
    mean = np.bincount(index, left) / count
    inner = float(np.sum((left - mean[index]) ** 2)) / within
    outer = float(count @ mean**2) / between
    if outer <= inner * float(fdtri(between, within, 1.0 - BY_CHANCE)):
        return None
    return float(np.sqrt(outer / max(inner, 1e-300)))
