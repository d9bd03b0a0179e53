"""What an encoder that is off does to the accelerometer's coefficients, plan by plan.

    python benchmarks/accelerometer_encoder.py [--runs 6] [--case NAME]

In records with white noise the encoder reads 0.005 to 5 deg too much or too little: in one row,
from a row on, at one angle. One JSON object per plan on standard output: how many were tried; in
how many a coefficient is off by more than 5 u; how many of these have no flag that the plan does
not have anyhow, and how many only that of a drift; the largest error in u, and what is behind it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from accelerometer_estimator import TWO_SIDED, Case, recorded
from accelerometer_records import codes, off_in_u
from cases import print_cases
from numpy.typing import NDArray

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset
from procedures.accelerometer_magnetic_sensitivity.from_import import plan_angles

Mask = NDArray[np.bool_]

PLANS = (
    Case("two planes, 24 angles, there and back", ("io", "ip"), passes=2),
    Case("three planes, 24 angles"),
    Case("one plane, 24 angles", ("io",)),
    Case("efficient, two planes, shuffled", ("io", "ip"), 9, TWO_SIDED, shuffled=True),
    Case("efficient, two planes, as published", ("io", "ip"), 9, TWO_SIDED),
    Case("efficient, three planes, as published", angles=9, fields_T=TWO_SIDED),
    Case("two planes, eight angles", ("io", "ip"), 8, TWO_SIDED),
    Case("one plane, nine angles, shuffled", ("io",), 9, TWO_SIDED, shuffled=True),
    Case("one plane, nine angles, as published", ("io",), 9, TWO_SIDED),
    Case("one plane, eight angles, as published", ("io",), 8, TWO_SIDED),
    Case("one plane, seven angles, as published", ("io",), 7, TWO_SIDED),
    Case("one plane, six angles, as published", ("io",), 6),
)
SIZES_DEG = (0.005, 0.02, 0.1, 0.5, 2.0, 5.0)
KINDS = ("one row", "from a row on", "one angle")
WRONG_U = 5.0


def off_rows(kind: str, dataset: AccelerometerDataset, generator: np.random.Generator) -> Mask:
    """Choose the rows in which the encoder is off."""
    row = int(generator.integers(1, len(dataset) - 1))
    rows = np.arange(len(dataset))
    if kind == "one row":
        return np.asarray(rows == row)
    if kind == "from a row on":
        return np.asarray(rows >= row)
    same = dataset.theta_deg == dataset.theta_deg[row]
    return np.asarray(same & (dataset.plane == dataset.plane[row]))


def measure(case: Case, runs: int) -> dict[str, object]:
    """Try every kind and size of jump in a plan."""
    tried = wrong = silent = only_drift = 0
    worst: tuple[float, str, float] = (0.0, "", 0.0)
    for seed in range(runs):
        dataset = recorded(case, seed)[0]
        for number, kind in enumerate(KINDS):
            for place, size_deg in enumerate(SIZES_DEG):
                generator = np.random.default_rng([seed, place, number, 7])
                off = off_rows(kind, dataset, generator)
                jump_deg = size_deg * float(generator.choice([-1.0, 1.0]))
                theta_deg = dataset.theta_deg + jump_deg * off
                plan_deg = plan_angles(dataset.plane, theta_deg)
                analysis = analyse(
                    replace(dataset, theta_deg=theta_deg, theta_commanded_deg=plan_deg)
                )
                error_u = max(off_in_u(analysis).values(), default=0.0)
                said = codes(analysis) - {"not-identifiable", "not-significant"}
                tried += 1
                worst = max(worst, (error_u, kind, jump_deg))
                wrong += error_u > WRONG_U
                silent += error_u > WRONG_U and not said
                only_drift += error_u > WRONG_U and said == {"drift-removed"}
    return {
        "tried": tried,
        "wrong": int(wrong),
        "without_a_flag": int(silent),
        "only_drift_flagged": int(only_drift),
        "largest_error_u": float(f"{worst[0]:.3g}"),
        "behind_it": f"{worst[2]:g} deg, {worst[1]}",
    }


if __name__ == "__main__":
    print_cases("An encoder that is off, plan by plan.", PLANS, measure, runs=6)
