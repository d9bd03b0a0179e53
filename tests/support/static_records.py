"""Records of gyros at rest with known noise, made in the time domain, and what is done to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.direction import Direction
from procedures.estimation.rate_spectrum import coefficients, covariances, noise_variances
from procedures.estimation.reml import Stretch, components_at
from procedures.gyro_static_noise.analysis import analyse
from procedures.gyro_static_noise.dataset import PER_SQRT_H, Record, StaticDataset
from procedures.gyro_static_noise.noise import rounding_variances

Array = NDArray[np.float64]

DEVICES = {
    "RLG": {"Q": 0.0, "N": 0.001, "B": 0.003, "K": 0.003, "pulse": 0.0625, "switch_on": 0.005},
    "RLG-coarse": {"Q": 0.0, "N": 0.001, "B": 0.003, "K": 0.003, "pulse": 0.4, "switch_on": 0.005},
    "FOG": {"Q": 0.0, "N": 0.005, "B": 0.02, "K": 0.03, "pulse": 0.0, "switch_on": 0.03},
    "MEMS": {"Q": 0.0, "N": 0.15, "B": 0.4, "K": 2.5, "pulse": 0.0, "switch_on": 2.0},
    "sensor": {"Q": 0.0, "N": 0.012, "B": 0.02, "K": 0.03, "pulse": 0.0, "switch_on": 0.05},
    "navigator": {"Q": 0.108, "N": 0.002, "B": 0.003, "K": 0.05, "pulse": 0.36, "switch_on": 0.01},
}
"""Q arcsec, N deg/sqrt(h), B deg/h, K deg/h/sqrt(h), pulse arcsec, switch-on deg/h."""
UP = Direction(0.0, np.pi / 2.0)
TRIADS: dict[str, dict[str, Direction]] = {
    "sensor": {"X": Direction(np.pi / 2.0, 0.0), "Y": Direction(0.0, 0.0), "Z": UP},
    "navigator": {"X": UP, "Y": UP, "Z": Direction(0.0, -np.pi / 2.0)},
}
"""A sensor shows three gyros at once; a navigator each upright in turn, no earth's rate in it."""
LATITUDE_RAD = float(np.deg2rad(39.9))
STABILITY_S = 10.0
LONGER = 4
"""How much longer flicker is made than it is used."""


def noise(rng: np.random.Generator, device: dict[str, float], count: int, t0: float) -> Array:
    """Return the means (n,) over t0 in s of a device's noise in deg/h, rounding left out."""
    angle_noise = device["Q"] * rng.standard_normal(count + 1)
    white = device["N"] * PER_SQRT_H / np.sqrt(t0) * rng.standard_normal(count)
    walk = device["K"] / PER_SQRT_H * np.sqrt(t0)
    steps, inner = walk * rng.standard_normal(count), walk * rng.standard_normal(count)
    # The mean of a walk over an interval: half its step, and what it strays in between.
    wandering = np.cumsum(steps) - 0.5 * steps + inner / np.sqrt(12.0)
    long = LONGER * count
    frequency = np.fft.rfftfreq(long, t0)
    # What lies beyond half the sample rate is folded back by taking means.
    parts = rng.standard_normal((2, len(frequency)))
    folded = np.zeros(len(frequency))
    for fold in range(-6, 7):
        own = np.maximum(np.abs(frequency + fold / t0), 0.5 * frequency[1])
        folded += device["B"] ** 2 / (2.0 * np.pi * own) * np.sinc(own * t0) ** 2
    spectrum = (parts[0] + 1j * parts[1]) * np.sqrt(0.5 * folded * long / t0)
    spectrum[0] = 0.0
    flicker = np.fft.irfft(spectrum, long)[:count]
    return np.asarray(np.diff(angle_noise) / t0 + white + wandering + flicker)


def counted(rate: Array, pulse: float, t0: float, begin: float) -> Array:
    """Return a rate as whole pulses of a counter, again as a rate."""
    angle = begin + np.concatenate(([0.0], np.cumsum(rate * t0)))
    return np.asarray(np.diff(np.floor(angle / pulse)) * pulse / t0)


def records(
    rng: np.random.Generator,
    device: dict[str, float],
    counts: Sequence[int],
    t0: float = 1.0,
    ramp_deg_per_h2: float = 0.0,
    bias_deg_per_h: float = 0.35,
    direction: Direction | None = UP,
) -> StaticDataset:
    """Return switch-ons of `counts` samples of a gyro with its input axis up or as it points.

    Without a direction the earth's rate is not in the output.
    """
    made = []
    earth = 0.0 if direction is None else direction.earth_deg_per_h(LATITUDE_RAD)
    for number, count in enumerate(counts, 1):
        time_s = 1800.0 + (np.arange(count) + 0.5) * t0
        own = bias_deg_per_h + device["switch_on"] * rng.standard_normal()
        rate = noise(rng, device, count, t0) + own + earth
        rate += ramp_deg_per_h2 * (time_s - time_s.mean()) / 3600.0
        if device["pulse"]:
            rate = counted(rate, device["pulse"], t0, rng.uniform(0.0, device["pulse"]))
        made.append(Record(number, time_s, rate[:, None]))
    axes = {"IA": direction or UP}
    told = direction is not None
    return StaticDataset(axes, LATITUDE_RAD, t0, device["pulse"], None, tuple(made), told)


def together(axes: Mapping[str, Direction], gyros: Sequence[StaticDataset]) -> StaticDataset:
    """Return the records of several gyros at the same times as those of a triad."""
    switch_ons = zip(*(gyro.records for gyro in gyros), strict=True)
    records = tuple(
        replace(own[0], rate_deg_per_h=np.hstack([record.rate_deg_per_h for record in own]))
        for own in switch_ons
    )
    return replace(gyros[0], directions=axes, records=records)


@dataclass(frozen=True)
class Found:
    """Errors and u of Q², N², B², K² and R, shape (runs, 5), which were covered; lines seen."""

    errors: Array
    u: Array
    covered: NDArray[np.bool_]
    lines: int


def true_squares(device: dict[str, float]) -> Array:
    """Return the squares of Q with its rounding, N in deg/h sqrt(s), B, K in deg/h/sqrt(s)."""
    return np.array(
        [
            device["Q"] ** 2 + device["pulse"] ** 2 / 12.0,
            (device["N"] * PER_SQRT_H) ** 2,
            device["B"] ** 2,
            (device["K"] / PER_SQRT_H) ** 2,
        ]
    )


def measured_squares(device: dict[str, float], runs: int, count: int, seed: int = 0) -> Found:
    """Return what the analysis makes of many records with a ramp of ten u."""
    ramp = 10.0 * float(bound_of_squares(device, count)[4])
    truth = true_squares(device)
    errors, spread, covered, lines = [], [], [], 0
    rng = np.random.default_rng(seed)
    for _ in range(runs):
        analysis = analyse(records(rng, device, [count], ramp_deg_per_h2=ramp))
        fit = analysis.axes[0].fit
        assert fit is not None
        errors.append([*(fit.theta - truth), fit.ramp - ramp])
        spread.append([*fit.u, fit.ramp_u])
        inside = (fit.intervals[:, 0] <= truth) & (truth <= fit.intervals[:, 1])
        covered.append([*inside, abs(fit.ramp - ramp) <= 1.96 * fit.ramp_u])
        lines += len(fit.lines)
    return Found(np.array(errors), np.array(spread), np.array(covered), lines)


def bound_of_squares(device: dict[str, float], count: int, t0: float = 1.0) -> Array:
    """Return the Cramér-Rao bounds (5,) of the four squares and of the ramp."""
    time_s = (np.arange(count) - 0.5 * (count - 1)) * t0
    parts = noise_variances(count, t0)
    theta, pulse = true_squares(device), device["pulse"]
    rates = np.linspace(0.0, pulse or 1.0, 8, endpoint=False)  # any fraction of a pulse alike
    rest = rounding_variances(count, t0, pulse, device["N"] * PER_SQRT_H, rates)
    theta = theta - np.array([pulse**2 / 12.0, 0.0, 0.0, 0.0])
    ramp = coefficients(time_s[:, None] / 3600.0)
    stretch = Stretch(np.zeros(count - 1), parts, rest, ramp)
    at = components_at([stretch], theta)
    return np.array([*at.u, float(np.sqrt(at.solved[0].covariance[0, 0]))])


def stability_deg_per_h(device: dict[str, float], count: int, ramp_deg_per_h2: float) -> float:
    """Return the expected standard deviation of a record's 10 s means, its ramp among them."""
    means = int(count // STABILITY_S)
    lags = np.arange(means)
    pairs = np.where(lags == 0, means, 2.0 * (means - lags))
    own = covariances(means, STABILITY_S)
    square = (own[:, 0] - own @ pairs / means**2) * means / (means - 1)
    hours = STABILITY_S * lags / 3600.0
    return float(np.sqrt(true_squares(device) @ square + ramp_deg_per_h2**2 * np.var(hours)))
