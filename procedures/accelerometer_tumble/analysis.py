"""The results of a tumble test: coefficients, bias, misalignment, the fixture's error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.estimation.flags import not_identifiable
from procedures.estimation.folding import Terms
from station.findings import Analysis, Estimate, Flag, undetermined

from .dataset import AnalysisSettings, TumbleDataset
from .flags import ARCSEC, data_flags, fold_flags, result_flags
from .misread import misread_flags
from .model import COEFFICIENTS, GRAVITY_POWER, UNITS, Array, judge
from .published import published_values
from .screening import screen
from .solution import ENCODER, MOUNTING, Solution, solve

SETTINGS = AnalysisSettings()
METHOD = "least-squares"
FEWEST_LEFT = 2.0
RATIOS = (
    ("bias", None, "K0", "g", 1.0),
    ("misalignment", "o", "Ko", "arcsec", ARCSEC),
    ("misalignment", "p", "Kp", "arcsec", ARCSEC),
    ("fixture_error", None, "Kf", "arcsec", ARCSEC),
)
"""Result, axis, the coefficient that is taken over Ki, unit, what the ratio is multiplied by."""


@dataclass(frozen=True)
class TumbleAnalysis(Analysis):
    """The results, and what they rest on; `solution` is None where nothing is determined."""

    used: TumbleDataset
    terms: Terms
    solution: Solution | None


def analyse(dataset: TumbleDataset, settings: AnalysisSettings = SETTINGS) -> TumbleAnalysis:
    """Return the results of a dataset."""
    screened = screen(dataset)
    used = screened.dataset
    flags = data_flags(dataset, screened)
    terms: Terms = {}
    if len(used.time_s):
        theta = used.commanded_rad + used.head_rad
        terms = judge(used.plane, used.reverse, theta, used.gravity_g)
    solution = None
    if len(used.time_s) > len(terms):
        solved = solve(used, tuple(terms), settings)
        solution = solved if solved.freedom >= FEWEST_LEFT else None
    misread = misread_flags(used, tuple(terms), solution, settings) if solution else []
    solution = None if misread else solution
    estimates = _estimates(used, terms, solution)
    flags += fold_flags(terms)
    flags += misread
    if misread:
        sentence = "What the columns mean is in doubt: no results."
        flags.append(not_identifiable(sentence, COEFFICIENTS))
    elif solution is None:
        sentence = (
            "There are too few readings beyond the coefficients to show the noise: no results."
        )
        flags.append(not_identifiable(sentence, COEFFICIENTS))
    else:
        scale = float(solution.value[list(terms).index("Ki")]) if "Ki" in terms else 0.0
        flags += result_flags(used, solution, estimates, scale, settings)
    published = published_values(used) if len(used.time_s) else []
    flags += _unpublished([entry.name for entry in published if entry.value is None])
    return TumbleAnalysis(estimates, published, flags, used, terms, solution)


def _unpublished(names: list[str]) -> list[Flag]:
    if not names:
        return []
    said = (
        "The multipoint formulas need 8 or more evenly spaced positions of one mounting; they give "
        f"no {', '.join(names)}."
    )
    return [Flag("outside-published-range", said, None, {"coefficients": names})]


def _estimates(dataset: TumbleDataset, terms: Terms, solution: Solution | None) -> list[Estimate]:
    """Return one estimate for each result, in the order of the contract."""
    names = list(terms)
    held_at: dict[str, object] = {}
    if dataset.temperature_degC is not None and len(dataset.time_s):
        held_at = {"conditions": {"temperature": f"{np.mean(dataset.temperature_degC):.1f} degC"}}
    estimates = []
    for name, unit in UNITS.items():
        own: dict[str, object] = {"terms": terms[name]} if name in terms else {}
        if solution is None or name not in terms:
            estimates.append(undetermined(name, None, unit, METHOD, own))
            continue
        gradient = np.eye(len(names))[names.index(name)]
        value = float(gradient @ solution.value)
        power = GRAVITY_POWER[unit]
        depends = {"multimeter_gain": value, "local_gravity": -power * value / dataset.gravity_g}
        if name == "K0":
            depends["multimeter_zero"] = 1.0
        term = {"K0": "K0_T", "Ki": "Ki_T"}.get(name)
        if term in solution.by_temperature:
            depends["thermometer_degC"] = solution.by_temperature[term]
        extra = {**own, **held_at} if name in ("K0", "Ki") else own
        estimates.append(_estimate((name, None, unit), value, gradient, solution, depends, extra))
    for name, axis, over, unit, factor in RATIOS:
        alone = over == "K0" or len(terms.get(over, {})) == 1
        if solution is None or over not in terms or "Ki" not in terms or not alone:
            estimates.append(undetermined(name, axis, unit, METHOD))
            continue
        scale = float(solution.value[names.index("Ki")])
        value = factor * float(solution.value[names.index(over)]) / scale
        gradient = np.zeros(len(names))
        gradient[names.index(over)] = factor / scale
        gradient[names.index("Ki")] = -value / scale
        depends = {}
        if name == "bias":
            zero = factor / scale
            depends = {"multimeter_zero": zero, "local_gravity": value / dataset.gravity_g}
        estimates.append(_estimate((name, axis, unit), value, gradient, solution, depends, {}))
    return estimates


def _estimate(
    what: tuple[str, str | None, str],
    value: float,
    gradient: Array,
    solution: Solution,
    depends: Mapping[str, float],
    extra: Mapping[str, object],
) -> Estimate:
    """Return an estimate; encoder and mountings, each one input, are not in its type A u."""
    name, axis, unit = what
    u = float(np.sqrt(gradient @ solution.noise @ gradient))
    by_prior = (gradient @ solution.by_prior) ** 2
    encoder = solution.priors.encoder
    own = {
        kind: float(np.sqrt(np.sum(by_prior[rows])))
        for kind, rows in ((ENCODER, encoder), (MOUNTING, ~encoder))
    }
    sensitivities = {**depends, **own}
    return Estimate(
        name, axis, value, unit, u, solution.freedom, METHOD, sensitivities, dict(extra)
    )
