"""The results of a gyro on a rate table, all its records in one solution, and the textbook's.

The textbook's: rate of the table as commanded, output less the mean at rest of the same switch-on,
a line by least squares (practice after IEEE Std 952; no clause is quoted).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.measured import Measured
from station.findings import Analysis, Estimate, Published, undetermined

from .checks import data_flags, result_flags
from .dataset import PPM, AnalysisSettings, Array, RateTableDataset
from .parameters import UNITS
from .screening import Kept, Screened, Within, runs_of, screen, within_records
from .solution import JointFit, Results, results_of, solution_of

SETTINGS = AnalysisSettings()
DEAD = 1e-3
METHODS = {"bias": "mean", "scale_factor_repeatability": "standard-deviation"}


@dataclass(frozen=True)
class RateTableAnalysis(Analysis):
    """The results, and what they rest on."""

    screened: Screened | None = None
    fit: JointFit | None = None
    results: Results | None = None
    within: Within | None = None


@dataclass(frozen=True)
class TriadAnalysis(Analysis):
    """The results of several axes, each measured upright by itself."""

    axes: Mapping[str, RateTableAnalysis] = field(default_factory=dict)


def together(axes: Mapping[str, RateTableAnalysis]) -> TriadAnalysis:
    """Return the results of several axes as one analysis."""
    return TriadAnalysis(
        [estimate for own in axes.values() for estimate in own.estimates],
        [published for own in axes.values() for published in own.published],
        [flag for own in axes.values() for flag in own.flags],
        axes,
    )


def analyse(dataset: RateTableDataset, settings: AnalysisSettings = SETTINGS) -> RateTableAnalysis:
    """Return the results of a dataset."""
    screened = screen(dataset, settings.outlier)
    # A dead output has no scale factor, not one of zero.
    records = screened.kept if abs(screened.scale) > DEAD else ()
    level = dataset.earth_level_deg_per_h
    within = within_records(records, dataset.sample_interval_s, level) if records else None
    fit = results = None
    if within is not None:
        own = end_variance(records, dataset.encoder_accuracy_deg, screened.scale)
        runs = runs_of(records, within, dataset.sample_interval_s)
        fit = solution_of(records, within, own, screened.scale, runs)
        results = results_of(fit, dataset.range_deg_per_s)
    estimates = _estimates(dataset, results, level, fit.switch_ons if fit is not None else 0)
    published = published_values(records, screened.scale * dataset.earth_up_deg_per_h, dataset.axis)
    flags = data_flags(dataset, screened, settings)
    flags += result_flags(screened, fit, results, estimates, settings)
    flags = [replace(flag, axis=dataset.axis) for flag in flags]
    return RateTableAnalysis(estimates, published, flags, screened, fit, results, within)


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
    dataset: RateTableDataset, results: Results | None, level_deg_per_h: float, switch_ons: int
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
            estimates.append(undetermined(name, dataset.axis, unit, method))
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
        if name == "scale_factor_repeatability":
            extra["switch_ons"] = switch_ons
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
            Estimate(name, dataset.axis, value, unit, measured.u, freedom, method, depends, extra)
        )
    return estimates


METHOD = "least-squares"


def published_values(records: Sequence[Kept], earth_deg_per_h: float, axis: str) -> list[Published]:
    """Return what the rules give on the same data, None where they cannot run."""
    values: dict[str, float | None] = dict.fromkeys(UNITS)
    del values["nonlinearity"]
    repeats = list(dict.fromkeys(kept.record.repeat for kept in records))
    lines, rests = [], []
    for repeat in repeats:
        own = [kept for kept in records if kept.record.repeat == repeat]
        rest = [kept.mean for kept in own if not kept.record.commanded_deg_per_s]
        turned = [kept for kept in own if kept.record.commanded_deg_per_s]
        if not rest or len(turned) < 2:
            continue
        rests.append(float(np.mean(rest)))
        rate = np.array([kept.record.commanded_deg_per_s for kept in turned]) * SECONDS_PER_HOUR
        lines.append(_line(rate, np.array([kept.mean for kept in turned]) - rests[-1]))
    if lines:
        scale = float(np.mean([line[0] for line in lines]))
        values["scale_factor"] = scale
        values["nonlinearity_of_full_scale"] = float(np.mean([line[1] for line in lines]))
        values["asymmetry"] = float(np.mean([line[2] for line in lines]))
        values["bias"] = float(np.mean(rests)) - earth_deg_per_h
    if len(lines) > 1:
        spread = float(np.std([line[0] for line in lines], ddof=1))
        values["scale_factor_repeatability"] = PPM * spread / abs(scale)
    methods = {"bias": "mean", "scale_factor_repeatability": "standard-deviation"}
    return [
        Published(name, axis, value, UNITS[name], methods.get(name, METHOD))
        for name, value in values.items()
    ]


def _line(rate: Array, output: Array) -> tuple[float, float, float]:
    """Return slope, largest residual over the largest output and |K+ - K-|/K, these in ppm."""
    design = np.column_stack((rate, np.ones(len(rate))))
    (slope, offset), *_ = np.linalg.lstsq(design, output, rcond=None)
    left = output - slope * rate - offset
    largest = float(np.max(np.abs(left)) / np.max(np.abs(output))) * PPM
    up, down = (
        float(rate[sense] @ output[sense]) / max(float(rate[sense] @ rate[sense]), 1e-300)
        for sense in (rate > 0.0, rate < 0.0)
    )
    return float(slope), largest, abs(up - down) / abs(float(slope)) * PPM
