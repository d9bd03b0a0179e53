"""Records of a nine-axis sensor on plate and table, made by arithmetic of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from procedures.nine_axis_calibration.analysis import NineAxisAnalysis
from procedures.nine_axis_calibration.dataset import (
    NineAxisDataset,
    Prior,
    StaticRecord,
    TurnRecord,
)

Array = NDArray[np.float64]

ARCMIN = np.pi / 10800.0
LATITUDE_DEG = 39.9
HORIZONTAL = 15.041 * np.cos(np.radians(LATITUDE_DEG))
VERTICAL = 15.041 * np.sin(np.radians(LATITUDE_DEG))
RATES = (1.0, 5.0, 10.0, 50.0, 100.0)
PRIOR = Prior(10.0 * ARCMIN, 0.5 * ARCMIN, 0.5 * ARCMIN, 1e-4)
BIAS = np.array([0.21, -0.12, 0.07])
SCALE = np.array([1.00012, 0.99991, 1.00004])
ASYMMETRY = np.array([9e-6, -6e-6, 4e-6])
CROSS = np.array([[0.0, 4e-4, -3e-4], [2e-4, 0.0, 5e-4], [-6e-4, 1e-4, 0.0]])
"""Input axis of gyro (row) towards axis (column), in rad."""
NOISE_deg_per_h = 0.6
EAST, NORTH, UP = np.eye(3)
STANDS = {
    1: (EAST, NORTH, UP),
    2: (-NORTH, EAST, UP),
    3: (NORTH, UP, EAST),
    4: (-EAST, -NORTH, UP),
    5: (NORTH, -EAST, UP),
    6: (-NORTH, UP, -EAST),
}


@dataclass(frozen=True)
class Setting:
    """What differs from a quiet, ideal calibration."""

    seed: int = 0
    positions: Sequence[int] = (1, 2, 3)
    stands_as: dict[int, int] = field(default_factory=dict)
    heading_arcmin: float = 0.0
    static_s: int = 200
    rates: Sequence[float] = RATES
    dwell_s: int = 72
    noise: float = NOISE_deg_per_h
    nonlinearity_ppm: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    table_ppm: float = 0.0
    cross: bool = True
    alone: bool = False
    """Whether only the turned axis was recorded on the table."""


def record(setting: Setting | None = None) -> NineAxisDataset:
    """Return the records of one calibration."""
    one = setting or Setting()
    generator = np.random.default_rng([one.seed, 77])
    gain = SCALE[:, None] * (np.eye(3) + one.cross * CROSS)
    static = [still(one, position, gain, generator) for position in one.positions]
    turns = [
        turn(one, axis, sense * rate, one.nonlinearity_ppm[n], gain, generator)
        for axis in range(3)
        for n, rate in enumerate(one.rates)
        for sense in (1, -1)
    ]
    return NineAxisDataset(LATITUDE_DEG, PRIOR, tuple(static), tuple(turns))


def still(one: Setting, position: int, gain: Array, generator: np.random.Generator) -> StaticRecord:
    """Return a static record; a heading error turns the sensor clockwise seen from above."""
    psi = one.heading_arcmin * ARCMIN
    c, s = np.cos(psi), np.sin(psi)
    clockwise = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    axes = np.array(STANDS[one.stands_as.get(position, position)]) @ clockwise.T
    felt = axes @ np.array([0.0, HORIZONTAL, VERTICAL])
    count = one.static_s
    rate = BIAS + gain @ felt + one.noise * generator.standard_normal((count, 3))
    acceleration = axes[:, 2] + 1e-4 * generator.standard_normal((count, 3))
    return StaticRecord(position, np.arange(1.0, count + 1), rate, acceleration)


def turn(
    one: Setting,
    axis: int,
    commanded: float,
    deviation_ppm: float,
    gain: Array,
    generator: np.random.Generator,
) -> TurnRecord:
    """Return a record on the table, the turned axis up, positive counter-clockwise from above."""
    count = one.dwell_s if one.dwell_s * abs(commanded) >= 360 else round(360 / abs(commanded))
    rate = commanded * (1.0 + 1e-6 * one.table_ppm)
    time_s = np.arange(1.0, count + 1)
    end_deg = generator.uniform(0.0, 360.0) + rate * time_s
    fine = np.radians(end_deg[:, None] - rate * (np.arange(200) + 0.5) / 200)
    felt = np.empty((count, 3))
    felt[:, axis] = rate + VERTICAL / 3600.0
    felt[:, (axis + 1) % 3] = HORIZONTAL / 3600.0 * np.cos(fine).mean(axis=1)
    felt[:, (axis + 2) % 3] = -HORIZONTAL / 3600.0 * np.sin(fine).mean(axis=1)
    output = felt @ gain.T + BIAS / 3600.0
    bent = 1e-6 * deviation_ppm + np.sign(rate) * ASYMMETRY[axis] / 2.0
    output[:, axis] += SCALE[axis] * rate * bent
    output += one.noise / 3600.0 * generator.standard_normal((count, 3))
    if one.alone:
        output[:, [n for n in range(3) if n != axis]] = np.nan
    return TurnRecord(axis, commanded, time_s, output, np.round(np.mod(end_deg, 360.0), 5))


def total_u(analysis: NineAxisAnalysis, name: str, axis: str) -> float:
    """Return an estimate's standard uncertainty, the parts of the priors included."""
    one = analysis.estimate(name, axis)
    assert one.standard_uncertainty is not None
    parts = [size for part, size in one.sensitivities.items() if part.startswith("prior_")]
    parts = parts if name == "bias" else []
    return float(np.hypot(one.standard_uncertainty, np.linalg.norm(parts)))


def off_in_u(analysis: NineAxisAnalysis) -> dict[tuple[str, str], float]:
    """Return how many standard uncertainties each determined estimate is off the truth."""
    found = {}
    for axis, name in enumerate("XYZ"):
        truths = {
            "bias": BIAS[axis],
            "scale_factor": SCALE[axis],
            "asymmetry": 1e6 * ASYMMETRY[axis],
        }
        for kind, truth in truths.items():
            value = analysis.estimate(kind, name).value
            if value is not None:
                found[kind, name] = abs(value - truth) / total_u(analysis, kind, name)
    for gyro, own in enumerate("XYZ"):
        for axis, other in enumerate("XYZ"):
            if gyro == axis:
                continue
            one = analysis.estimate("misalignment", own + other)
            if one.value is not None and one.standard_uncertainty:
                truth = CROSS[gyro, axis] * 648000.0 / np.pi
                found["misalignment", own + other] = (
                    abs(one.value - truth) / one.standard_uncertainty
                )
    return found


def codes(analysis: NineAxisAnalysis) -> set[str]:
    """Return the codes of an analysis' flags."""
    return {flag.code for flag in analysis.flags}
