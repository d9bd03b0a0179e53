"""The results of a tumble test: coefficients, bias, misalignment, the fixture's error.

Beside them stand the multipoint formulas: a Fourier series over evenly spaced positions of one
mounting. K0 = B0 + C2, Ki = S1 + 3 S3, Kii = -2 C2, Kiii = -4 S3, Kio = 2 S2, Ko = C1: the
fixture's error, the encoder's and drift are taken for the device's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import ARCSEC_PER_RAD
from procedures.estimation.flags import not_identifiable
from procedures.estimation.folding import Terms
from procedures.estimation.slow_terms import USUAL
from station.findings import Analysis, Estimate, Flag, Published, undetermined

from .checks import fold_flags, misread_flags, result_flags, screened
from .dataset import AnalysisSettings, TumbleDataset
from .model import COEFFICIENTS, GRAVITY_POWER, UNITS, Array, judge
from .solution import ENCODER, MOUNTING, Solution, solve

SETTINGS = AnalysisSettings()
METHOD, FORMULAS = "least-squares", "fourier"
FEWEST_LEFT = 2.0
RATIOS = (
    ("bias", None, "K0", "g", 1.0),
    ("misalignment", "o", "Ko", "arcsec", ARCSEC_PER_RAD),
    ("misalignment", "p", "Kp", "arcsec", ARCSEC_PER_RAD),
    ("fixture_error", None, "Kf", "arcsec", ARCSEC_PER_RAD),
)
"""Result, axis, the coefficient that is taken over Ki, unit, what the ratio is multiplied by."""
FEWEST_POSITIONS, EVEN_DEG = 8, 0.01
IN_PLANE = {"io": ("Kio", "Ko"), "ip": ("Kip", "Kp")}
PUBLISHED = ("K0", "Ki", "Kii", "Kiii", "Kio", "Kip", "Ko", "Kp")


@dataclass(frozen=True)
class TumbleAnalysis(Analysis):
    """The results, and what they rest on; `solution` is None where nothing is determined.

    `temperature_lost` says that a thermometer was read and gave no temperatures that can be used.
    """

    used: TumbleDataset
    terms: Terms
    solution: Solution | None
    temperature_lost: bool = False


def analyse(dataset: TumbleDataset, settings: AnalysisSettings = SETTINGS) -> TumbleAnalysis:
    """Return the results of a dataset."""
    used, flags = screened(dataset)
    # A set-point that the stage did not go to says nothing of what the positions determine.
    reached = used.only(~used.far)
    terms: Terms = {}
    if len(reached.time_s):
        theta = reached.commanded_rad + reached.head_rad
        terms = judge(reached.plane, reached.reverse, theta, reached.gravity_g)
    solution = None
    if len(used.time_s) > len(terms) > 0:
        solved = solve(used, tuple(terms), settings)
        solution = solved if solved.freedom >= FEWEST_LEFT else None
    misread = misread_flags(used, tuple(terms), solution, settings) if solution else []
    why = "There are too few readings beyond the coefficients to show the noise: no results."
    if misread:
        solution, why = None, "What the columns mean is in doubt: no results."
    lost = dataset.temperature_degC is not None and used.temperature_degC is None
    estimates = _estimates(used, terms, solution, lost)
    without = [
        f"{estimate.name} {estimate.axis or ''}".rstrip()
        for estimate in estimates
        if estimate.value is None and estimate.name not in COEFFICIENTS
    ]
    flags += fold_flags(terms, without) + misread
    if solution is None:
        flags.append(not_identifiable(why, [*COEFFICIENTS, *without]))
    else:
        flags += result_flags(used, solution, estimates, settings)
    published = _published(reached)
    if lacking := [entry.name for entry in published if entry.value is None]:
        formulas_text = (
            "The multipoint formulas need 8 or more evenly spaced positions of one mounting; they "
            f"give no {', '.join(lacking)}."
        )
        beyond = {"coefficients": lacking}
        flags.append(Flag("outside-published-range", formulas_text, None, beyond))
    return TumbleAnalysis(estimates, published, flags, used, terms, solution, lost)


def _estimates(
    dataset: TumbleDataset, terms: Terms, solution: Solution | None, lost: bool
) -> list[Estimate]:
    """Return one estimate for each result, in the order of the contract."""
    names = list(terms)
    held_at: dict[str, object] = {}
    if dataset.temperature_degC is not None and len(dataset.time_s):
        held_at = {"conditions": {"temperature": f"{np.mean(dataset.temperature_degC):.1f} degC"}}
    estimates = []
    for name, unit in UNITS.items():
        extra: dict[str, object] = {"terms": terms[name]} if name in terms else {}
        if solution is None or name not in terms:
            estimates.append(undetermined(name, None, unit, METHOD, extra))
            continue
        gradient = np.eye(len(names))[names.index(name)]
        value = float(gradient @ solution.value)
        power = GRAVITY_POWER[unit]
        depends = {"multimeter_gain": value, "local_gravity": -power * value / dataset.gravity_g}
        if name == "K0":
            depends["multimeter_zero"] = 1.0
        if fixture := terms[name].get("Kf"):
            depends["encoder_zero"] = fixture * solution.of("Ki")
        if name in ("K0", "Ki"):
            extra |= held_at
        depends |= _by_warmth(solution, lost, (name, 1.0))
        estimates.append(_estimate((name, None, unit), value, gradient, solution, depends, extra))
    for name, axis, over, unit, factor in RATIOS:
        alone = over == "K0" or len(terms.get(over, {})) == 1
        if solution is None or over not in terms or "Ki" not in terms or not alone:
            estimates.append(undetermined(name, axis, unit, METHOD))
            continue
        per_unit = factor / solution.of("Ki")
        value = solution.of(over) * per_unit
        gradient = np.zeros(len(names))
        gradient[names.index(over)] = per_unit
        gradient[names.index("Ki")] = -value / solution.of("Ki")
        depends = {}
        if name == "bias":
            depends = {"multimeter_zero": per_unit, "local_gravity": value / dataset.gravity_g}
            depends |= _by_warmth(
                solution, lost, ("K0", per_unit), ("Ki", -value / solution.of("Ki"))
            )
        if name == "fixture_error":
            depends = {"encoder_zero": factor}
        extra = held_at if name == "bias" else {}
        estimates.append(_estimate((name, axis, unit), value, gradient, solution, depends, extra))
    return estimates


def _by_warmth(solution: Solution, lost: bool, *parts: tuple[str, float]) -> dict[str, float]:
    """Return the slope over temperature of a sum of coefficients, each with its factor.

    Where the temperatures are lost it is the size that is usual, for the results depend on the
    temperature all the same.
    """
    if lost:
        ki = abs(solution.of("Ki"))
        usual = [factor * ki * USUAL.get(f"{name}_T", 0.0) for name, factor in parts]
        return {"thermometer_degC": float(np.hypot.reduce(usual))} if any(usual) else {}
    slopes = {name: solution.slow.get(f"{name}_T") for name, _ in parts}
    if all(slope is None for slope in slopes.values()):
        return {}
    return {"thermometer_degC": sum(factor * (slopes[name] or 0.0) for name, factor in parts)}


def _estimate(
    what: tuple[str, str | None, str],
    value: float,
    gradient: Array,
    solution: Solution,
    depends: Mapping[str, float],
    extra: Mapping[str, object],
) -> Estimate:
    """Return an estimate; encoder and mountings, each one input, are not in its type A u."""
    u = float(np.sqrt(gradient @ solution.noise @ gradient))
    by_prior = (gradient @ solution.by_prior) ** 2
    encoder = solution.priors.encoder
    beside = {
        kind: float(np.sqrt(np.sum(by_prior[rows])))
        for kind, rows in ((ENCODER, encoder), (MOUNTING, ~encoder))
    }
    return Estimate(
        *what[:2],
        value,
        what[2],
        u,
        solution.freedom,
        METHOD,
        {**depends, **beside},
        extra,
    )


def _published(dataset: TumbleDataset) -> list[Published]:
    """Return what the formulas give on each plane's first mounting, None where they cannot run."""
    values: dict[str, float] = {}
    for plane, (product, cross) in IN_PLANE.items():
        if (series := _series(dataset, plane)) is None:
            continue
        mean, sine, cosine = series
        own = {
            "K0": mean + cosine[1],
            "Ki": sine[0] + 3.0 * sine[2],
            "Kii": -2.0 * cosine[1],
            "Kiii": -4.0 * sine[2],
            product: 2.0 * sine[1],
            cross: cosine[0],
        }
        of_gravity = {
            name: value / dataset.gravity_g ** GRAVITY_POWER[UNITS[name]]
            for name, value in own.items()
        }
        values = of_gravity | values
    return [Published(name, None, values.get(name), UNITS[name], FORMULAS) for name in PUBLISHED]


def _series(dataset: TumbleDataset, plane: str) -> tuple[float, list[float], list[float]] | None:
    """Return the mean and the first sines and cosines of a plane's first mounting, V."""
    first = np.flatnonzero((dataset.plane == plane) & (dataset.reverse > 0.0))
    if not len(first):
        return None
    rows = dataset.mounting == dataset.mounting[first[0]]
    angle = np.mod(np.rad2deg((dataset.commanded_rad + dataset.head_rad)[rows]), 360.0)
    place, index = np.unique(np.round(angle, 6) % 360.0, return_inverse=True)
    uneven = np.ptp(np.diff(np.append(place, place[0] + 360.0))) > EVEN_DEG
    if len(place) < FEWEST_POSITIONS or uneven:
        return None
    mean = np.bincount(index, dataset.output_V[rows]) / np.bincount(index)
    theta = np.deg2rad(place)
    sine = [2.0 * float(np.mean(mean * np.sin(n * theta))) for n in (1, 2, 3)]
    cosine = [2.0 * float(np.mean(mean * np.cos(n * theta))) for n in (1, 2)]
    return float(np.mean(mean)), sine, cosine
