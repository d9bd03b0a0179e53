"""Simulated records of an accelerometer in a field, by equations of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from procedures.accelerometer_magnetic_sensitivity.dataset import (
    AccelerometerAnalysis,
    AccelerometerDataset,
)
from station.findings import Estimate

Array = NDArray[np.float64]

SIX_FIELDS_T = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05)
NOISE_V = 3e-6
INTERVAL_S = 10.0
TRUTH = {
    "K0": 3.9e-3,
    "Ki": 1.00007,
    "Kii": 15e-6,
    "Kiii": 12e-6,
    "Kio": -14e-6,
    "Kip": -6e-6,
    "Koo": 11e-6,
    "Kpp": -5e-6,
    "Km": 0.0135,
    "Kmm": 0.12,
    "Kim": 0.015,
    "Kom": -0.005,
    "Kpm": -0.0024,
}


def points(
    planes: Sequence[str], angles: int, fields_T: Sequence[float] = SIX_FIELDS_T
) -> tuple[NDArray[np.str_], Array, Array]:
    """Return plane, angle in deg, field in T of each row: plane by plane, angle by angle."""
    rows = [
        (plane, 360.0 * n / angles, field)
        for plane in planes
        for n in range(angles)
        for field in fields_T
    ]
    plane, angle, field = zip(*rows, strict=True)
    return np.array(plane), np.array(angle), np.array(field)


def axes_g(plane: NDArray[np.str_], theta: Array) -> tuple[Array, Array, Array]:
    """Return Ai, Ao, Ap of each row."""
    sine, cosine = np.sin(theta), np.cos(theta)
    level = np.where(plane == "level", 1.0, 0.0)
    i = np.where((plane == "io") | (plane == "ip"), sine, 0.0)
    o = np.where(plane == "io", cosine, np.where(plane == "op", sine, 0.0))
    return i, o, np.where((plane == "ip") | (plane == "op"), cosine, level)


def output_V(i: Array, o: Array, p: Array, b: Array) -> Array:
    """Return the output without noise."""
    k = TRUTH
    still = k["K0"] + k["Ki"] * i + k["Kii"] * i**2 + k["Kiii"] * i**3
    still = still + k["Kio"] * i * o + k["Kip"] * i * p + k["Koo"] * o**2 + k["Kpp"] * p**2
    return still + (k["Km"] + k["Kim"] * i + k["Kom"] * o + k["Kpm"] * p) * b + k["Kmm"] * b**2


def record(
    seed: int,
    planes: Sequence[str] = ("io", "ip"),
    angles: int = 9,
    fields_T: Sequence[float] = (-0.05, 0.0, 0.05),
    *,
    noise_V: float = NOISE_V,
    offset_arcsec: float = 0.0,
    drift_V: Array | float = 0.0,
    temperature_degC: Array | None = None,
    K0_per_K: float = 0.0,
    Ki_per_K: float = 0.0,
    misalignment: tuple[float, float] = (0.0, 0.0),
    field_gain: float = 1.0,
) -> AccelerometerDataset:
    """Simulate one record; the field is `field_gain` times the commanded one."""
    generator = np.random.default_rng([seed, 11])
    plane, angle_deg, commanded_T = points(planes, angles, fields_T)
    count = len(plane)
    field_T = field_gain * commanded_T + 1e-6 * generator.standard_normal(count)
    theta = np.radians(angle_deg) + np.radians(offset_arcsec / 3600.0)
    i, o, p = axes_g(plane, theta)
    output = output_V(i, o, p, field_T) + misalignment[0] * o + misalignment[1] * p + drift_V
    if temperature_degC is not None:
        warmer = temperature_degC - temperature_degC.mean()
        output = output + K0_per_K * warmer + Ki_per_K * warmer * i
    return AccelerometerDataset(
        time_s=INTERVAL_S * np.arange(count),
        plane=plane,
        theta_deg=angle_deg,
        theta_commanded_deg=angle_deg,
        field_T=field_T,
        field_commanded_T=commanded_T,
        output_V=output + noise_V * generator.standard_normal(count),
        temperature_degC=temperature_degC,
        evenly_timed=True,
    )


def estimate(analysis: AccelerometerAnalysis, name: str) -> Estimate:
    """Return the estimate of a coefficient."""
    return next(one for one in analysis.estimates if one.name == name)


def off_in_u(
    analysis: AccelerometerAnalysis, truth: Mapping[str, float] = TRUTH
) -> dict[str, float]:
    """Return how far each determined combination is from the truth, in its u."""
    found = {}
    for one in analysis.estimates:
        if one.value is not None and one.standard_uncertainty is not None:
            true = sum(share * truth[name] for name, share in one.extra["terms"].items())
            found[one.name] = abs(one.value - true) / one.standard_uncertainty
    return found


def codes(analysis: AccelerometerAnalysis) -> set[str]:
    """Return the codes of the flags."""
    return {flag.code for flag in analysis.flags}
