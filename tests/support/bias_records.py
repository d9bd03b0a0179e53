"""Records of gyros over temperature with known bias and noise, made in the time domain."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from static_records import noise

from procedures.estimation.direction import Direction
from procedures.gyro_bias_temperature.analysis import analyse
from procedures.gyro_bias_temperature.dataset import TemperatureDataset
from procedures.gyro_bias_temperature.model import lagged, loop

Array = NDArray[np.float64]

INTERVAL_S, FINE = 60.0, 6
LATITUDE_RAD = float(np.deg2rad(39.9))
STEPS = ((-40, 1.0), (-20, 1.0), (0, 1.0), (20, 1.0), (40, 1.0), (60, 1.0), (23, 0.5))
"""Temperatures that are soaked at, degC, and how fast each is gone to, degC/min."""


@dataclass(frozen=True)
class Gyro:
    """A gyro and its chamber; the curve in deg/h over -36.5 to 65 degC of its own thermometer."""

    curve: tuple[float, ...] = (0.11, 0.297, 0.09, -0.047)
    rate_sensitivity: float = 0.4
    hysteresis: float = 0.06
    half_width: float = 5.0
    sensor_lag_s: float = 300.0
    chamber_lag_s: float = 2100.0
    warmer: float = 4.7
    N: float = 0.005
    B: float = 0.004
    K: float = 0.008
    soak_h: float = 2.0
    steps: tuple[tuple[float, float], ...] = STEPS
    reference_degC: float = 20.0
    spikes: tuple[int, ...] = ()
    lost: slice = field(default_factory=lambda: slice(0, 0))
    thermometer: bool = True
    self_heating: float = 0.0

    def bias(self, temperature: Array | float) -> Array:
        """Return the curve at temperatures, deg/h."""
        return np.asarray(
            chebyshev.chebval(
                (2.0 * (np.asarray(temperature) + self.self_heating) - 28.5) / 101.5, self.curve
            )
        )


CASES = {
    "fibre-optic": Gyro(),
    "straight curve": Gyro(curve=(0.1, 0.3)),
    "no hysteresis, no lag": Gyro(hysteresis=0.0, sensor_lag_s=0.0),
    "noisy": Gyro(N=0.02, B=0.02, K=0.03),
    "chamber alone": Gyro(thermometer=False),
    "chamber alone, straight curve": Gyro(thermometer=False, curve=(0.1, 0.3)),
    "chamber alone, one lag": Gyro(thermometer=False, sensor_lag_s=0.0, chamber_lag_s=1400.0),
    "chamber alone, noisy": Gyro(thermometer=False, N=0.02, B=0.02, K=0.03),
}


def record(gyro: Gyro, seed: int) -> TemperatureDataset:
    """Return a record of a gyro, rows of a minute, means of ten-second steps."""
    rng = np.random.default_rng(seed)
    step_s = INTERVAL_S / FINE
    soak = round(gyro.soak_h * 3600.0 / step_s)
    targets, soaking = [np.full(soak, 23.0)], [np.ones(soak, dtype=bool)]
    last = 23.0
    for target, degC_per_min in gyro.steps:
        count = max(1, round(abs(target - last) / degC_per_min * FINE))
        targets += [np.linspace(last, target, count + 1)[1:], np.full(soak, float(target))]
        soaking += [np.zeros(count, dtype=bool), np.ones(soak, dtype=bool)]
        last = target
    chamber = np.concatenate(targets)
    own = lagged(chamber, gyro.chamber_lag_s, step_s) + gyro.warmer
    effective = lagged(own, gyro.sensor_lag_s, step_s)
    bias = gyro.bias(effective) + gyro.rate_sensitivity * np.gradient(own, step_s) * 60.0
    bias = bias + 0.5 * gyro.hysteresis * loop(effective, gyro.half_width)
    rows = len(chamber) // FINE

    def mean(values: Array) -> Array:
        return np.asarray(values[: rows * FINE].reshape(rows, FINE).mean(axis=1))

    direction = Direction(0.0, np.pi / 2.0)
    device = {"Q": 0.0, "N": gyro.N, "B": gyro.B, "K": gyro.K}
    rate = mean(bias) + noise(rng, device, rows, INTERVAL_S)
    rate = rate + direction.earth_deg_per_h(LATITUDE_RAD)
    rate[list(gyro.spikes)] += 5.0
    kept = np.ones(rows, dtype=bool)
    kept[gyro.lost] = False
    last_step = slice(FINE - 1, rows * FINE, FINE)
    own_read = mean(own) + rng.normal(0.0, 0.005, rows)
    return TemperatureDataset(
        {"IA": direction},
        LATITUDE_RAD,
        INTERVAL_S,
        gyro.reference_degC,
        300.0,
        (INTERVAL_S * (np.arange(rows) + 0.5))[kept],
        np.concatenate(soaking)[last_step][kept],
        np.round(chamber[last_step], 3)[kept],
        rate[kept, None],
        own_read[kept] if gyro.thermometer else None,
        (mean(chamber) + rng.normal(0.0, 0.03, rows))[kept],
    )


def truths(gyro: Gyro, dataset: TemperatureDataset) -> dict[str, float]:
    """Return the true results of a gyro in a record.

    With the chamber's thermometer alone the curve is that of the chamber's temperature.
    """
    if not gyro.thermometer:
        whole = replace(gyro, thermometer=True, warmer=0.0, self_heating=gyro.warmer)
        lag_s = gyro.sensor_lag_s + gyro.chamber_lag_s
        return truths(whole, dataset) | {"sensor_lag": lag_s}
    low, high = np.ptp(dataset.temperature_degC), dataset.temperature_degC
    middle, half = 0.5 * (high.min() + high.max()), 0.45 * float(low)
    inner = np.linspace(middle - half, middle + half, 2001)
    slopes = np.abs(np.gradient(gyro.bias(inner), inner))
    at = gyro.reference_degC
    ends = np.array([target + gyro.warmer for target in (23.0, *(to for to, _ in gyro.steps))])
    ends = ends[np.abs(ends - at) >= 5.0]
    return {
        "bias": float(gyro.bias(at)),
        "bias_temperature_sensitivity": float(
            np.max(np.abs(gyro.bias(ends) - gyro.bias(at)) / np.abs(ends - at))
        ),
        "largest_bias_slope": float(slopes.max()),
        "bias_rate_sensitivity": gyro.rate_sensitivity,
        "hysteresis": gyro.hysteresis,
        "sensor_lag": gyro.sensor_lag_s,
        "chamber_lag": gyro.chamber_lag_s,
    }


def errors_in_u(gyro: Gyro, seed: int) -> dict[str, tuple[float, float]]:
    """Return for each result its error and its standard uncertainty."""
    dataset = record(gyro, seed)
    analysis, true = analyse(dataset), truths(gyro, dataset)
    return {
        one.name: (one.value - true[one.name], one.standard_uncertainty)
        for one in analysis.estimates
        if one.value is not None and one.standard_uncertainty is not None
    }
