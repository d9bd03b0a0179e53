"""Laser-gyro records made for the tests, and shorthand to read an analysis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.rlg_magnetic_sensitivity.analysis import analyse
from procedures.rlg_magnetic_sensitivity.dataset import AXES, RlgDataset, Segment
from procedures.rlg_magnetic_sensitivity.fitted import RlgAnalysis
from procedures.rlg_magnetic_sensitivity.frequencies import Drive

Array = NDArray[np.float64]
SIGMA = 0.19  # deg/h in 0.1 s: 0.001 deg/sqrt(h)
TRUTH = {"IA": 0.05, "NA": -0.02, "LA": 0.001}


def record(
    seed: int = 0,
    sensitivity: dict[str, float] | None = None,
    drive: dict[str, Drive] | None = None,
    cycles: float = 20.0,
    interval_s: float = 0.1,
    sigma: float = SIGMA,
    coils: Array | None = None,
    ambient_mT: tuple[float, float, float] = (0.012, -0.031, 0.024),
    quadratic: float = 0.0,
    delay_s: float = 0.0,
    averaging_s: float = 0.0,
    drift: Array | float = 0.0,
) -> Segment:
    """Make one record; `coils[a, b]` is the field on axis b per unit of drive of coil a."""
    generator = np.random.default_rng([seed, 11])
    sensitivity = {"IA": 0.05} if sensitivity is None else sensitivity
    drive = {"IA": Drive(0.1, 1.0)} if drive is None else drive
    coils = np.eye(3) if coils is None else coils
    count = round(cycles / next(iter(drive.values())).frequency_Hz / interval_s)
    middle_s = np.asarray(12.0 + (np.arange(count) + 0.5) * interval_s, dtype=np.float64)
    fine = (np.arange(16) + 0.5) / 16.0 - 0.5

    def field(time_s: Array) -> Array:
        total = np.tile(np.array(ambient_mT), (*np.shape(time_s), 1))
        for k, (axis, one) in enumerate(drive.items()):
            angle = 2.0 * np.pi * one.frequency_Hz * time_s + seed + k
            wave = one.amplitude_mT * np.sin(angle)
            total = total + wave[..., None] * coils[AXES.index(axis)]
        return np.asarray(total)

    slopes = np.array([sensitivity.get(axis, 0.0) for axis in AXES])
    seen = field(middle_s[:, None] + fine * interval_s - delay_s)
    rate = 9.3 + (seen @ slopes + quadratic * seen[..., 0] ** 2).mean(axis=1)
    rate = rate + drift + sigma * generator.standard_normal(count)
    measured = field(middle_s[:, None] + fine * averaging_s).mean(axis=1)
    measured = measured + 2e-4 * generator.standard_normal((count, 3))
    return Segment(drive, interval_s, middle_s, rate, 0.0, middle_s, measured, averaging_s)


def analysed(*segments: Segment) -> RlgAnalysis:
    return analyse(RlgDataset(segments))


def codes(analysis: RlgAnalysis) -> set[str]:
    return {flag.code for flag in analysis.flags}


def off_in_u(analysis: RlgAnalysis, axis: str, truth: float) -> float:
    one = next(e for e in analysis.estimates if e.axis == axis)
    assert one.value is not None and one.standard_uncertainty is not None
    return abs(one.value - truth) / one.standard_uncertainty
