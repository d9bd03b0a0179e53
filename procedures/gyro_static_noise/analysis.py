"""The results of gyros at rest, noise by maximum likelihood, bias by means, and the textbook's.

The textbook's: coefficients read off the slopes of the Allan deviation, and plain spreads. Each
slope's line is laid through the point of the curve whose own slope comes nearest to it, and read at
the averaging time where the coefficient stands (practice after IEEE Std 952).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.allan import AllanDeviation, allan_deviation, pooled_deviation
from procedures.estimation.channel import Channel, screen
from procedures.estimation.measured import Measured, root
from procedures.estimation.noise import grid_index
from station.findings import Analysis, Estimate, Flag, Published, undetermined

from .checks import AxisAnalysis, axis_flags, dataset_flags
from .dataset import COEFFICIENTS, PER_SQRT_H, AnalysisSettings, Array, StaticDataset
from .means import (
    allan_minimum,
    bias_of,
    moving_all,
    repeatability_of,
    stability_of,
)
from .noise import FEWEST, Burst, NoiseFit, Pieces, fit_noise, pieces, without_bursts
from .parameters import UNITS

FACTORS = np.array([1.0, 1.0 / PER_SQRT_H, 1.0, PER_SQRT_H])
"""From arcsec, deg/h sqrt(s), deg/h, deg/h/sqrt(s) to the units of the results."""
ROUNDING = "the rounding of a rate is white and stands in the angle random walk."
SETTINGS = AnalysisSettings()
BY_CLOCK = {
    "quantisation_noise": 0.0,
    "angle_random_walk": -0.5,
    "rate_random_walk": -1.5,
    "rate_ramp": -2.0,
}
"""The power of the time that goes into a result, where it is not that of a rate."""
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
        flags += axis_flags(analysed, settings)
        axes.append(analysed)
    flags += dataset_flags(dataset, axes, settings)
    return StaticAnalysis(estimates, published, flags, tuple(axes))


def _axis(
    dataset: StaticDataset, number: int, axis: str, settings: AnalysisSettings
) -> AxisAnalysis:
    records, interval_s = dataset.records, dataset.sample_interval_s
    output = Channel(
        f"the output of {axis}",
        "the gyro",
        "deg/h",
        quantum=dataset.quantum_deg_per_h,
        when_coarse="" if dataset.pulse_arcsec else ROUNDING,
    )
    screened = tuple(
        screen(output, record.rate_deg_per_h[:, number], settings.outlier) for record in records
    )
    grids = [
        own.on_grid(grid_index(record.time_s, interval_s))
        for record, own in zip(records, screened, strict=True)
    ]
    fit, bursts = _noise(dataset, grids, settings), list[Burst]()
    if fit is not None:
        grids, bursts = without_bursts(records, grids, fit)
    if bursts:
        fit = _noise(dataset, grids, settings)
    rates = [rate[np.isfinite(rate)] for rate in grids]
    means = np.array([float(rate.mean()) for rate in rates if len(rate)])
    counts = np.array([len(rate) for rate in rates if len(rate)])
    if fit is None:
        return AxisAnalysis(axis, screened, means, counts, None, bursts)
    minimum, curve = allan_minimum(fit), curve_of(fit.pieces, interval_s)
    moving = moving_all(records, grids, fit)
    return AxisAnalysis(axis, screened, means, counts, fit, bursts, minimum, curve, moving)


def _noise(
    dataset: StaticDataset, grids: Sequence[Array], settings: AnalysisSettings
) -> NoiseFit | None:
    """Return the noise of the records that are at least half as long as the longest."""
    parts = [piece for rate in grids for piece in pieces(rate)]
    fewest = max(FEWEST, 0.5 * max(map(len, parts), default=0))
    known = Pieces(
        tuple(piece for piece in parts if len(piece) >= fewest),
        dataset.sample_interval_s,
        dataset.pulse_arcsec,
        dataset.output_bandwidth_Hz,
    )
    return fit_noise(known, settings.periodic_chance)


def _estimates(dataset: StaticDataset, analysed: AxisAnalysis) -> list[Estimate]:
    """Return one estimate for each result of an axis, in the order of the contract."""
    by_name: dict[str, Measured | None] = {}
    extra: dict[str, dict[str, Any]] = {}
    fit, means = analysed.fit, analysed.means
    theta = None if fit is None else fit.theta
    if fit is not None:
        for n, (name, factor) in enumerate(zip(COEFFICIENTS, FACTORS, strict=True)):
            square, u = float(fit.theta[n]), float(fit.u[n])
            measured = root(square, u)
            by_name[name] = Measured(measured.value * factor, measured.u * factor)
            interval = [float(x) for x in np.sqrt(fit.intervals[n]) * factor]
            upper = float(np.sqrt(square + 1.645 * u) * factor)
            extra[name] = {"upper_limit": upper, "interval": interval}
        if dataset.output_bandwidth_Hz is not None:
            del by_name[COEFFICIENTS[0]]
        by_name["rate_ramp"] = Measured(fit.ramp, fit.ramp_u)
        by_name["bias_stability"] = stability_of(fit)
    if (minimum := analysed.minimum) is not None:
        by_name["allan_minimum"] = minimum.measured
        extra["allan_minimum"] = {"tau_s": minimum.tau_s}
    if len(means):
        lengths_s = analysed.counts * dataset.sample_interval_s
        by_name["bias"] = bias_of(means, float(lengths_s[0]), fit, *analysed.moving)
        by_name["bias_repeatability"] = repeatability_of(means, lengths_s, theta)
        extra["bias_repeatability"] = {"switch_ons": len(means)}
    estimates = []
    for name, unit in UNITS.items():
        method = METHODS.get(name, "maximum-likelihood")
        quantity = by_name.get(name)
        if quantity is None:
            estimates.append(undetermined(name, analysed.axis, unit, method))
            continue
        value, more = quantity.value, extra.get(name, {})
        # As read: the earth's rate is in it. Rates go with the pulse and against the time.
        depends = {"pulse_weight": value, "clock": BY_CLOCK.get(name, -1.0) * value}
        if name == "bias":
            value -= dataset.earth_deg_per_h(analysed.axis)
        if name == "bias" and dataset.earth_in_output:
            direction = dataset.directions[analysed.axis]
            azimuth, elevation = direction.sensitivities(dataset.latitude_rad)
            depends |= {
                f"azimuth_{analysed.axis}": -azimuth,
                f"elevation_{analysed.axis}": -elevation,
            }
        u, freedom = quantity.u, quantity.degrees_of_freedom
        estimates.append(
            Estimate(name, analysed.axis, value, unit, u, freedom, method, depends, more)
        )
    return estimates


METHOD = "allan-slopes"
READINGS = {
    "quantisation_noise": (-1.0, np.sqrt(3.0), 1.0),
    "angle_random_walk": (-0.5, 1.0, 1.0 / PER_SQRT_H),
    "bias_instability": (0.0, 1.0, 1.0 / np.sqrt(2.0 * np.log(2.0) / np.pi)),
    "rate_random_walk": (0.5, 3.0, PER_SQRT_H),
    "rate_ramp": (1.0, np.sqrt(2.0), SECONDS_PER_HOUR),
}
"""Slope, averaging time in s at which its line is read, and the factor to the result's unit."""
FEWEST_POINTS = 3


def curve_of(pieces: Sequence[Array], interval_s: float) -> AllanDeviation:
    """Return the overlapping Allan deviation of the records, pooled where they are equally long.

    Of records of different lengths it is that of the longest ones.
    """
    longest = max(len(piece) for piece in pieces)
    return pooled_deviation(
        [allan_deviation(piece, interval_s) for piece in pieces if len(piece) == longest]
    )


def published_values(axis: str, curve: AllanDeviation, means: Array) -> list[Published]:
    """Return what the rules give on the same data, None where they cannot run."""
    values = {name: _read(curve, *how) for name, how in READINGS.items()}
    values["allan_minimum"] = float(curve.deviation.min()) if len(curve.tau_s) else None
    values["bias_repeatability"] = float(np.std(means, ddof=1)) if len(means) > 1 else None
    methods = {"bias_repeatability": "standard-deviation"}
    return [
        Published(name, axis, values[name], UNITS[name], methods.get(name, METHOD))
        for name in UNITS
        if name in values
    ]


def _read(curve: AllanDeviation, slope: float, at_s: float, factor: float) -> float | None:
    if len(curve.tau_s) < FEWEST_POINTS or not bool(np.all(curve.deviation > 0.0)):
        return None
    tau, deviation = np.log(curve.tau_s), np.log(curve.deviation)
    own = np.diff(deviation) / np.diff(tau)
    nearest = int(np.argmin(np.abs(own - slope)))
    line = deviation[nearest] + slope * (np.log(at_s) - tau[nearest])
    return float(np.exp(line) * factor)
