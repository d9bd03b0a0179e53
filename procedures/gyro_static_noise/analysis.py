"""The results of gyros at rest: noise by restricted maximum likelihood, bias by means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from procedures.estimation.channel import Channel, screen
from procedures.estimation.flags import gaps_of
from procedures.estimation.measured import Measured, root
from procedures.estimation.noise import grid_index
from station.findings import Analysis, Estimate, Flag, Published, undetermined

from .axis import AxisAnalysis, without_bursts
from .bridging import bridged, pieces
from .dataset import COEFFICIENTS, PER_SQRT_H, AnalysisSettings, Array, Record, StaticDataset
from .earth import earth_flags
from .flags import data_flags, noise_flags
from .means import (
    allan_minimum,
    bias_of,
    repeatability_of,
    stability_of,
    walked_by_the_mean,
)
from .noise_fit import FEWEST, NoiseFit, Pieces, fit_noise, noise_records
from .parameters import UNITS
from .published import curve_of, published_values
from .warm_up import Unbroken, tail_in_mean

FACTORS = np.array([1.0, 1.0 / PER_SQRT_H, 1.0, PER_SQRT_H])
"""From arcsec, deg/h sqrt(s), deg/h, deg/h/sqrt(s) to the units of the results."""
ROUNDING = "the rounding of a rate is white and stands in the angle random walk."
SETTINGS = AnalysisSettings()
METHODS = {"bias": "mean", "bias_stability": "standard-deviation"}
METHODS["bias_repeatability"] = "standard-deviation"


@dataclass(frozen=True)
class StaticAnalysis(Analysis):
    """All axes' results, and what they rest on."""

    axes: tuple[AxisAnalysis, ...] = ()


def analyse(dataset: StaticDataset, settings: AnalysisSettings = SETTINGS) -> StaticAnalysis:
    """Return the results of a dataset, axis by axis."""
    estimates: list[Estimate] = []
    published: list[Published] = []
    flags: list[Flag] = []
    axes = []
    for number, axis in enumerate(dataset.directions):
        analysed = _axis(dataset, number, axis, settings)
        estimates += _estimates(dataset, analysed)
        if analysed.curve is not None:
            published += published_values(axis, analysed.curve, analysed.means)
        flags += data_flags(dataset, analysed)
        flags += noise_flags(analysed, settings)
        axes.append(analysed)
    first = [float(own.means[0]) if len(own.means) else np.nan for own in axes]
    flags += earth_flags(dataset, first)
    gaps = sum(
        (
            gaps_of(record.time_s, dataset.sample_interval_s, settings.gap)
            for record in dataset.records[1:]
        ),
        gaps_of(dataset.records[0].time_s, dataset.sample_interval_s, settings.gap)
        if dataset.records
        else gaps_of(np.empty(0), 1.0, 1.0),
    )
    consequence = "short ones are bridged by what the noise lets stand there, long ones divide"
    flags += gaps.flags("The records have", dataset.sample_interval_s, f"{consequence} the record")
    return StaticAnalysis(estimates, published, flags, tuple(axes))


def _axis(
    dataset: StaticDataset, number: int, axis: str, settings: AnalysisSettings
) -> AxisAnalysis:
    interval_s = dataset.sample_interval_s
    output = Channel(
        f"the output of {axis}",
        "the gyro",
        "deg/h",
        quantum=dataset.quantum_deg_per_h,
        when_coarse="" if dataset.pulse_arcsec else ROUNDING,
    )
    screened = tuple(
        screen(output, record.rate_deg_per_h[:, number], settings.outlier)
        for record in dataset.records
    )
    grids = [
        own.on_grid(grid_index(record.time_s, interval_s))
        for record, own in zip(dataset.records, screened, strict=True)
    ]
    fit = _noise(dataset, grids, settings)
    grids, disturbed = without_bursts(dataset.records, grids, fit, interval_s)
    if disturbed:
        fit = _noise(dataset, grids, settings)
    rates = tuple(rate[np.isfinite(rate)] for rate in grids)
    means = np.array([float(rate.mean()) for rate in rates if len(rate)])
    counts = np.array([len(rate) for rate in rates if len(rate)])
    if fit is None:
        return AxisAnalysis(axis, screened, means, counts, None, None, None, disturbed)
    longest_s = max(len(piece) for piece in fit.pieces) * interval_s
    minimum = allan_minimum(fit.theta, fit.covariance, interval_s, longest_s)
    curve = curve_of(fit.pieces, interval_s)
    tail, walked = _common(dataset.records, grids, fit, interval_s)
    known = (disturbed, tail, walked)
    return AxisAnalysis(axis, screened, means, counts, fit, minimum, curve, *known)


def _noise(
    dataset: StaticDataset, grids: Sequence[Array], settings: AnalysisSettings
) -> NoiseFit | None:
    rates = noise_records([piece for rate in grids for piece in pieces(rate)])
    pulse, bandwidth_Hz = dataset.pulse_arcsec, dataset.output_bandwidth_Hz
    known = Pieces(rates, dataset.sample_interval_s, pulse, bandwidth_Hz)
    return fit_noise(known, settings.periodic_chance)


def _common(
    records: Sequence[Record], grids: Sequence[Array], fit: NoiseFit, interval_s: float
) -> tuple[float, float]:
    """Return what moves the means of all switch-ons alike, in deg/h: warm-up and walk."""
    used = [pair for pair in zip(records, grids, strict=True) if np.isfinite(pair[1]).any()]
    earliest_s = min(float(record.time_s[0]) for record, _ in used)
    unbroken = []
    for record, rate in used:
        since_s = float(record.time_s[0]) - earliest_s
        longest = max(pieces(rate), key=len)
        if len(longest) < FEWEST:
            continue
        filled = bridged(longest, interval_s, fit.theta, 0.0)
        # A long record may have a ramp of its own; a short one would be left nothing by it.
        long = len(filled) >= min(len(piece) for piece in fit.pieces)
        beside = fit.columns(len(filled), interval_s) if long else np.empty((len(filled), 0))
        unbroken.append(Unbroken(filled, since_s, beside))
    tail = tail_in_mean(unbroken, interval_s, fit.theta)
    starts = [record.on_s for record, _ in used]
    if len(used) < 2 or any(start is None for start in starts):
        return tail, 0.0
    middles_s = np.array([(record.on_s or 0.0) + record.time_s.mean() for record, _ in used])
    return tail, walked_by_the_mean(middles_s, fit.theta, float(fit.u[3]))


def _estimates(dataset: StaticDataset, analysed: AxisAnalysis) -> list[Estimate]:
    """Return one estimate for each result of an axis, in the order of the contract."""
    by_name: dict[str, tuple[Measured, dict[str, Any]]] = {}
    theta = None if analysed.fit is None else analysed.fit.theta
    if analysed.fit is not None:
        first = 0 if analysed.fit.quantisation_seen else 1
        for n in range(first, len(COEFFICIENTS)):
            square, u = float(analysed.fit.theta[n]), float(analysed.fit.u[n])
            measured = root(square, u)
            interval = [float(x) for x in np.sqrt(analysed.fit.intervals[n]) * FACTORS[n]]
            upper = float(np.sqrt(square + 1.645 * u) * FACTORS[n])
            scaled = Measured(measured.value * FACTORS[n], measured.u * FACTORS[n])
            by_name[COEFFICIENTS[n]] = scaled, {"upper_limit": upper, "interval": interval}
        by_name["rate_ramp"] = Measured(analysed.fit.ramp, analysed.fit.ramp_u), {}
        if (minimum := analysed.minimum) is not None:
            by_name["allan_minimum"] = minimum.measured, {"tau_s": minimum.tau_s}
        stability = stability_of(analysed.fit, dataset.sample_interval_s)
        if stability is not None:
            by_name["bias_stability"] = stability, {}
    lengths_s = analysed.counts * dataset.sample_interval_s
    if len(analysed.means):
        bias = bias_of(analysed.means, float(lengths_s[0]), theta, analysed.tail, analysed.walked)
        if bias is not None:
            by_name["bias"] = bias, {}
        repeats = repeatability_of(analysed.means, lengths_s, theta)
        if repeats is not None:
            by_name["bias_repeatability"] = repeats, {"switch_ons": len(analysed.means)}
    estimates = []
    for name, unit in UNITS.items():
        method = METHODS.get(name, "maximum-likelihood")
        if name not in by_name:
            estimates.append(undetermined(name, analysed.axis, unit, method))
            continue
        measured, extra = by_name[name]
        value = measured.value
        # As read: the earth's rate is in it. Rates go with the pulse and against the time.
        depends = {"pulse_weight": value, "clock": -value}
        if name == "bias":
            direction = dataset.directions[analysed.axis]
            value -= direction.earth_deg_per_h(dataset.latitude_rad)
            azimuth, elevation = direction.sensitivities(dataset.latitude_rad)
            depends |= {
                f"azimuth_{analysed.axis}": -azimuth,
                f"elevation_{analysed.axis}": -elevation,
            }
        freedom = measured.degrees_of_freedom
        estimates.append(
            Estimate(name, analysed.axis, value, unit, measured.u, freedom, method, depends, extra)
        )
    return estimates
