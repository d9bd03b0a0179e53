"""From a solution to the results of one axis, in the order of the contract."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.estimation.measured import Measured
from station.findings import Estimate, undetermined

from .dataset import TemperatureDataset
from .fit import BiasFit, Setting
from .published import APART_DEGC
from .soaks import Soak
from .units import UNITS

METHOD = "maximum-likelihood"
INNER = 0.9
"""Part of the range over which the largest slope is looked for."""
PLACES = 181


def estimates_of(
    axis: str,
    dataset: TemperatureDataset,
    setting: Setting,
    fit: BiasFit | None,
    soaks: Sequence[Soak],
    lag: Measured | None,
) -> list[Estimate]:
    """Return one estimate for each result of an axis; those without a value are undetermined."""
    values: dict[str, Measured | None] = dict.fromkeys(UNITS)
    values["chamber_lag"] = lag
    if fit is not None:
        values |= _of_curve(dataset, setting, fit, soaks)
        for name, place in (("bias_rate_sensitivity", "s"), ("hysteresis", "H")):
            if fit.alone.get(place):
                values[name] = Measured(*fit.value_of(place))
        values["sensor_lag"] = Measured(*fit.value_of("lag"))
    estimates = []
    for name, unit in UNITS.items():
        method = "least-squares" if name == "chamber_lag" else METHOD
        measured = values[name]
        if measured is None:
            estimates.append(undetermined(name, axis, unit, method))
            continue
        depends, extra = {}, {}
        if name == "bias" and fit is not None:
            north, up = dataset.directions[axis].sensitivities(dataset.latitude_rad)
            depends = {f"azimuth_{axis}": -north, f"elevation_{axis}": -up}
            low, high = setting.domain
            extra = {
                "conditions": {"temperature": f"{dataset.reference_degC:g} degC"},
                "model": {
                    "basis": "chebyshev",
                    "domain": [low, high],
                    "unit": "degC",
                    "coefficients": fit.curve().tolist(),
                },
            }
        freedom = measured.degrees_of_freedom
        estimates.append(
            Estimate(name, axis, measured.value, unit, measured.u, freedom, method, depends, extra)
        )
    return estimates


def _of_curve(
    dataset: TemperatureDataset, setting: Setting, fit: BiasFit, soaks: Sequence[Soak]
) -> dict[str, Measured | None]:
    low, high = setting.domain
    reference = dataset.reference_degC
    at = float(setting.scaled(np.array([reference]))[0])
    values: dict[str, Measured | None] = {
        "largest_bias_slope": max(
            (_slope(fit, float(x), high - low) for x in np.linspace(-INNER, INNER, PLACES)),
            key=lambda slope: slope.value,
        )
    }
    if low <= reference <= high:
        values["bias"] = Measured(*fit.bias_at(at))
        far = [soak for soak in soaks if abs(soak.temperature_degC - reference) >= APART_DEGC]
        slopes = []
        for soak in far:
            there = float(setting.scaled(np.array([soak.temperature_degC]))[0])
            apart, u = fit.difference(there, at)
            span = abs(soak.temperature_degC - reference)
            slopes.append(Measured(abs(apart) / span, u / span))
        values["bias_temperature_sensitivity"] = max(
            slopes, key=lambda slope: slope.value, default=None
        )
    return values


def _slope(fit: BiasFit, scaled: float, span: float) -> Measured:
    value, u = fit.slope_at(scaled)
    return Measured(abs(value) * 2.0 / span, u * 2.0 / span)
