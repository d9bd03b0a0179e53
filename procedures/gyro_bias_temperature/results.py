"""From a solution to the results of one axis, in the order of the contract."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.estimation.measured import Measured
from station.findings import Estimate, undetermined

from .dataset import Array, TemperatureDataset
from .fit import BiasFit, Setting
from .published import APART_DEGC
from .soaks import Soak
from .units import UNITS

METHOD = "maximum-likelihood"
INNER = 0.9
"""Part of the range over which the largest slope is looked for."""
PLACES = 181
DRAWS = 500
"""Curves about the solution, and as many opposite ones."""


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
    curve, per_degC = fit.curve(), 2.0 / (high - low)
    inner = fit.slope_rows(np.linspace(-INNER, INNER, PLACES)) * per_degC
    values: dict[str, Measured | None] = {"largest_bias_slope": _largest(fit, inner)}
    if low <= reference <= high:
        at = setting.scaled(np.array([reference]))
        bias, u = fit.bias_at(float(at[0]))
        slope = float(fit.slope_rows(at)[0] @ curve) * per_degC
        values["bias"] = Measured(bias, float(np.hypot(u, slope * u_degC)))
        ends = np.array([soak.temperature_degC for soak in soaks])
        ends = ends[np.abs(ends - reference) >= APART_DEGC]
        if len(ends):
            there, spans = setting.scaled(ends), ends - reference
            rows = (fit.rows(there) - fit.rows(at)) / spans[:, None]
            more = fit.slope_rows(there) @ curve * per_degC * u_degC / spans
            values["bias_temperature_sensitivity"] = _largest(fit, rows, more)
    return values


def _largest(fit: BiasFit, rows: Array, more: Array | None = None) -> Measured:
    """Return the largest size of what follows from the curve by `rows` (n, order + 1).

    `more` (n,) is what else is unknown of each. The largest of noisy values is too large, and it
    may be another: u is the root mean square by which the largest of curves drawn about the
    solution stand off its own.
    """
    width = rows.shape[1]
    scale, axes = np.linalg.eigh(fit.covariance[:width, :width])
    # Orthogonal draws: where one place is by far the largest, u is just its own.
    drawn = np.linalg.qr(np.random.default_rng(DRAWS).standard_normal((DRAWS, width)))[0]
    root = (axes * np.sqrt(np.maximum(scale, 0.0))) @ axes.T
    apart = np.sqrt(DRAWS) * np.vstack([drawn, -drawn]) @ root @ rows.T
    value = rows @ fit.sizes[:width]
    at = int(np.argmax(np.abs(value)))
    largest = float(np.abs(value[at]))
    off = np.abs(value + apart).max(axis=1) - largest
    further = 0.0 if more is None else float(more[at])
    return Measured(largest, float(np.sqrt(np.mean(off**2) + further**2)))
