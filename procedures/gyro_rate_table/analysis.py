"""The results of a gyro on a rate table: all its records in one solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.measured import Measured
from station.findings import Analysis, Estimate, undetermined

from .dataset import PPM, AnalysisSettings, Array, RateTableDataset
from .flags import data_flags, drift_flag, result_flags
from .joint_fit import JointFit, drift_alone, fit_records, system_of
from .noise import Within, within_records
from .parameters import UNITS
from .published import published_values
from .results import Results, results_of
from .scale_drift import RARE, Runs, runs_of
from .screening import Kept, Screened, screen

SETTINGS = AnalysisSettings()
DEAD = 1e-3
MUCH_WALK = 3.0
"""Standard uncertainties by which the bias may walk more before a drift of K is looked for."""
METHODS = {"bias": "mean", "scale_factor_repeatability": "standard-deviation"}


@dataclass(frozen=True)
class RateTableAnalysis(Analysis):
    """The results, and what they rest on."""

    screened: Screened | None = None
    fit: JointFit | None = None
    results: Results | None = None


def analyse(dataset: RateTableDataset, settings: AnalysisSettings = SETTINGS) -> RateTableAnalysis:
    """Return the results of a dataset."""
    screened = screen(dataset, settings.outlier)
    # A dead output has no scale factor, not one of zero.
    records = screened.kept if abs(screened.scale) > DEAD else ()
    level = dataset.earth_level_deg_per_h
    within = within_records(records, dataset.sample_interval_s, level) if records else None
    fit = results = None
    drifts = False
    if within is not None:
        own = end_variance(records, dataset.encoder_accuracy_deg, screened.scale)
        runs = runs_of(records, within, dataset.sample_interval_s)
        fit, drifts = fit_of(records, within, own, screened.scale, runs)
        results = results_of(fit, dataset.range_deg_per_s)
    estimates = _estimates(dataset, results, level)
    published = published_values(records, screened.scale * dataset.earth_up_deg_per_h)
    flags = data_flags(dataset, screened, settings)
    flags += result_flags(screened, fit, results, estimates, settings)
    if fit is not None and drifts:
        flags.append(drift_flag(fit))
    return RateTableAnalysis(estimates, published, flags, screened, fit, results)


def fit_of(
    records: Sequence[Kept], within: Within, own: Array, scale: float, runs: Runs
) -> tuple[JointFit, bool]:
    """Return the solution, with a drift of the scale factor where there is one, and whether so."""
    steady = fit_records(records, system_of(records, within, own, scale, None))
    drifting = system_of(records, within, own, scale, runs)
    largest_walk = steady.walk + MUCH_WALK * steady.walk_u
    if len(drifting.layout.rates) > 1 and (
        runs.chance < RARE or drift_alone(drifting, largest_walk)
    ):
        return fit_records(records, drifting), True
    return steady, False


def end_variance(records: Sequence[Kept], accuracy_deg: float, scale: float) -> Array:
    """Return the variances (r,) in (deg/h)² that the angle at both ends brings beyond its scatter.

    The encoder's error comes back every turn: over whole turns it takes nothing away.
    """
    variances = []
    for kept in records:
        apart_deg = 2.0 * accuracy_deg * abs(np.sin(np.pi * kept.turns))
        end_deg = np.sqrt(2.0) * kept.record.angle_u_deg
        variances.append((apart_deg**2 + end_deg**2) / kept.length_s**2)
    return np.asarray(variances) * (scale * SECONDS_PER_HOUR) ** 2


def _estimates(
    dataset: RateTableDataset, results: Results | None, level_deg_per_h: float
) -> list[Estimate]:
    """Return one estimate for each result, in the order of the contract."""
    named: dict[str, Measured | None] = dict.fromkeys(UNITS)
    if results is not None:
        named = dict(
            zip(
                UNITS,
                (
                    results.scale_factor,
                    results.nonlinearity,
                    results.of_full_scale,
                    results.asymmetry,
                    results.repeatability,
                    results.bias,
                ),
                strict=True,
            )
        )
    estimates = []
    for name, unit in UNITS.items():
        method, measured = METHODS.get(name, "least-squares"), named[name]
        if measured is None:
            estimates.append(undetermined(name, "IA", unit, method))
            continue
        value, depends = measured.value, {}
        if name == "scale_factor":
            depends = {"clock": value, "alignment": value, "pulse_weight": value}
        if name == "bias":
            assert results is not None
            scale = results.scale_factor.value if results.scale_factor else 1.0
            value -= scale * dataset.earth_up_deg_per_h
            depends = {"level": scale * level_deg_per_h, "pulse_weight": value}
        freedom = measured.degrees_of_freedom
        extra: dict[str, object] = {}
        if name == "scale_factor" and results is not None:
            extra["rates"] = [
                {
                    "rate_deg_per_s": float(rate),
                    "scale_factor": float(factor),
                    "u_ppm": float(u) * PPM,
                }
                for rate, factor, u in zip(
                    results.nominal, results.factors, results.factors_u, strict=True
                )
                if np.isfinite(factor)
            ]
        estimates.append(
            Estimate(name, "IA", value, unit, measured.u, freedom, method, depends, extra)
        )
    return estimates
