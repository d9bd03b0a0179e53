"""Errors of a navigated drive of fibre-optic gyros, and what their uncertainties are worth.

    python benchmarks/fog_navigation.py [--runs 60] [--case NAME] [--store]

Seeds are 0 .. runs-1 of each case. One JSON object per case and result on standard output, of sizes
of position and velocity errors, without and with compensation: the true one, the mean standard
uncertainty, root mean square error over u, and coverage of the 95 % interval. Each drive has biases
as large as stated, noise, and a curve of turns of its own; true errors are those of the drive
without both, none with compensation.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

# Matrices of a hundred rows gain nothing from threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from cases import Scored, Trial, scored, summary
from figures import Figures
from fog_records import CURVES, record
from navigated_example import drive_of
from simulated_journey import simulated_journey

from procedures.fog_scale_factor_temperature.analysis import analyse
from procedures.fog_scale_factor_temperature.dataset import AXES, Drive
from procedures.fog_scale_factor_temperature.evaluate import to_findings
from procedures.fog_scale_factor_temperature.navigation import (
    ACCELEROMETER_BIAS,
    M_PER_S2_PER_UG,
    NAMES,
    POSITION,
    RUNS,
    VELOCITY,
    navigate_drive,
)
from station.findings import InputQuantity
from station.uncertainty import combine


@dataclass(frozen=True)
class Case:
    """Laps of a yard, four corners each, and the sensors."""

    name: str
    laps: int = 6
    gyro_bias_deg_per_h: float = 0.01
    accelerometer_bias_ug: float = 20.0
    gyro_noise_deg_per_s: float = 1e-4
    accelerometer_noise_m_per_s2: float = 1e-3


CASES = (
    Case("navigator"),
    Case("best gyros", 3, 2e-4, 5.0, 5e-6, 1e-4),
)


@cache
def truth_of(case: Case) -> tuple[Drive, dict[str, float]]:
    """Return the drive of gyros without bias and noise, and the true size of each error."""
    drive = drive_of(simulated_journey(CURVES, laps=case.laps))
    curves = {axis: fit.curve for axis, fit in analyse(record(0, axes=AXES)).fits.items()}
    error = navigate_drive(drive, {axis: own for axis, own in curves.items() if own}).error[0]
    truth = dict.fromkeys((f"{name}_{run}" for name in NAMES for run in RUNS), 0.0)
    position, velocity = (np.linalg.norm(error[:, part], axis=1) for part in (POSITION, VELOCITY))
    sizes = position.max(), position[-1], velocity.max()
    truth |= {f"{name}_{RUNS[0]}": float(own) for name, own in zip(NAMES, sizes, strict=True)}
    return drive, truth


def trial(case: Case, seed: int) -> tuple[Trial, dict[str, float]]:
    """Analyse a drive; return its errors, and the standard uncertainties."""
    pure, truth = truth_of(case)
    generator = np.random.default_rng([seed, 43])
    assert pure.specific_force_m_per_s2 is not None
    bias = case.gyro_bias_deg_per_h / 3600.0 * generator.standard_normal(3)
    push = case.accelerometer_bias_ug * M_PER_S2_PER_UG * generator.standard_normal(3)
    shape = pure.rate_deg_per_s.shape
    bias = bias + case.gyro_noise_deg_per_s * generator.standard_normal(shape)
    push = push + case.accelerometer_noise_m_per_s2 * generator.standard_normal(shape)
    drive = replace(
        pure,
        rate_deg_per_s=pure.rate_deg_per_s + bias,
        specific_force_m_per_s2=pure.specific_force_m_per_s2 + push,
    )
    turns = record(seed, axes=AXES, gyro_bias_deg_per_h=case.gyro_bias_deg_per_h)
    dataset = replace(turns, drive=drive)
    push_u = case.accelerometer_bias_ug
    inputs = [InputQuantity(ACCELEROMETER_BIAS, "each", push_u, "ug", "the case")]
    analysis = analyse(dataset)
    findings = to_findings(analysis, dataset, [], "the case", inputs)
    results: dict[str, Scored] = {}
    u: dict[str, float] = {}
    whole = combine(findings.estimates, [*findings.inputs, *inputs])
    for estimate, own in zip(findings.estimates, whole, strict=True):
        if estimate.name in truth and estimate.value is not None and own is not None:
            error = estimate.value - truth[estimate.name]
            u[estimate.name] = own.standard_uncertainty
            freedom = own.degrees_of_freedom
            results[estimate.name] = scored(error, own.standard_uncertainty, freedom)
    return Trial(results, frozenset(flag.code for flag in analysis.flags)), u


def measure(case: Case, runs: int) -> dict[str, dict[str, object]]:
    """Run one case and summarise each of its results."""
    trials = [trial(case, seed) for seed in range(runs)]
    return {
        name: {
            "true": round(true, 4),
            "mean_u": round(float(np.mean([u[name] for _, u in trials])), 4),
            **summary([own for own, _ in trials], name),
        }
        for name, true in truth_of(case)[1].items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Errors of a navigated drive.")
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--case", default="", help="only the cases whose name contains this")
    figures = Figures(parser)
    options = figures.parse()
    for case in CASES:
        if options.case in case.name:
            for name, line in measure(case, options.runs).items():
                figures.line(f"{case.name}, {name}", **line)


if __name__ == "__main__":
    main()
