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
    u_degC: float,
) -> list[Estimate]:
    """Return one estimate for each result of an axis; those without a value are undetermined.

    `u_degC` is what rounding and steps leave unknown of the temperature.
    """
    values: dict[str, Measured | None] = dict.fromkeys(UNITS)
    values["chamber_lag"] = lag
    if fit is not None:
        values |= _of_curve(dataset, setting, fit, soaks, u_degC)
        for name, place in (("bias_rate_sensitivity", "s"), ("hysteresis", "H")):
            if fit.alone.get(place) and fit.lag_seen:
                values[name] = Measured(*fit.value_of(place))
        if fit.lag_seen:
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
    dataset: TemperatureDataset,
    setting: Setting,
    fit: BiasFit,
    soaks: Sequence[Soak],
    u_degC: float,
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
        bias, u = fit.bias_at(at)
        slope = _slope(fit, at, high - low).value
        values["bias"] = Measured(bias, float(np.hypot(u, slope * u_degC)))
        far = [soak for soak in soaks if abs(soak.temperature_degC - reference) >= APART_DEGC]
        slopes = []
        for soak in far:
            there = float(setting.scaled(np.array([soak.temperature_degC]))[0])
            apart, u = fit.difference(there, at)
            span = abs(soak.temperature_degC - reference)
            own_slope = _slope(fit, there, high - low).value
            u = float(np.hypot(u, own_slope * u_degC))
            slopes.append(Measured(abs(apart) / span, u / span))
        values["bias_temperature_sensitivity"] = max(
            slopes, key=lambda slope: slope.value, default=None
        )
    return values


def _slope(fit: BiasFit, scaled: float, span: float) -> Measured:
    value, u = fit.slope_at(scaled)
    return Measured(abs(value) * 2.0 / span, u * 2.0 / span)
