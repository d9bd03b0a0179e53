"""How close the accelerometer estimator comes to the Cramer-Rao bound, case by case.

    python benchmarks/accelerometer_estimator.py [--runs 2000] [--case NAME]

Seeds are 0 .. runs-1 of each case. One JSON object per case on standard output: for every
coefficient or combination that the plan determines the root mean square error over the bound and
over the stated u, each with its standard error, and the coverage of the 95 % interval; the ratio
for the published finite-memory solution; how often which flag came. The bound is sigma^2 (X'X)^-1
with the columns of encoder offset, misalignment and, where there are any, temperature and drift
(Legendre 1 to 3) in X, over all rows of the plan: rows that are missing or wild are the estimator's
loss, not the bound's.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from accelerometer_records import INTERVAL_S, NOISE_V, SIX_FIELDS_T, TRUTH, axes_g, output_V
from cases import Trial, Trials, measured, of_estimates, of_published, print_cases

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset
from procedures.accelerometer_magnetic_sensitivity.model import judge

Array = NDArray[Any]

NAMES = tuple(TRUTH)
TWO_SIDED = (-0.05, 0.0, 0.05)
ARCSEC = np.pi / 648000.0


@dataclass(frozen=True)
class Case:
    """One plan and what disturbs it."""

    name: str
    planes: tuple[str, ...] = ("io", "ip", "op")
    angles: int = 24
    fields_T: tuple[float, ...] = SIX_FIELDS_T
    passes: int = 1
    shuffled: bool = False
    offset_arcsec: float = 0.0
    drift_V_per_h: float = 0.0
    warm_up_V: float = 0.0
    outliers: float = 0.0
    missing: float = 0.0
    warming_K: float = 0.0

    def points(self) -> tuple[NDArray[np.str_], Array, Array]:
        """Return plane, angle in deg and field in T of each row of the plan, in order."""
        angle_deg = 360.0 * np.arange(self.angles) / self.angles
        rows = [
            (plane, float(angle), field)
            for number in range(self.passes)
            for plane in self.planes
            for angle in angle_deg
            for field in self.fields_T[:: -1 if number % 2 else 1]
        ]
        order = np.arange(len(rows))
        if self.shuffled:
            np.random.default_rng(5).shuffle(order)
        plane, angle, field = zip(*(rows[n] for n in order), strict=True)
        return np.array(plane), np.array(angle), np.array(field)


DISTURBED = {
    "offset_arcsec": 10.0,
    "drift_V_per_h": 20e-6,
    "warm_up_V": 30e-6,
    "outliers": 0.03,
    "missing": 0.08,
}
CASES = (
    Case("white, three planes"),
    Case("white, one plane", planes=("io",), angles=72),
    Case("white, two planes, efficient", ("io", "ip"), 9, TWO_SIDED, passes=2),
    Case("white, two planes, fields 0 and B", ("io", "ip"), 24, (0.0, 0.05)),
    Case("disturbed, three planes, as published", **DISTURBED),  # type: ignore[arg-type]
    Case("disturbed, three planes, shuffled", shuffled=True, **DISTURBED),  # type: ignore[arg-type]
    Case("disturbed, one plane, shuffled", ("io",), 72, shuffled=True, **DISTURBED),  # type: ignore[arg-type]
    Case("disturbed, efficient, palindrome", ("io", "ip"), 9, TWO_SIDED, passes=8, **DISTURBED),  # type: ignore[arg-type]
    Case("faint drift, three planes, as published", drift_V_per_h=2e-6, warm_up_V=2e-6),
    Case("1 K warmer in the course, shuffled", warming_K=1.0, shuffled=True),
)


def columns(case: Case) -> dict[str, Array]:
    """Return the columns of the plan by the name of their coefficient; nuisances begin with `_`."""
    plane, angle_deg, field = case.points()
    theta = np.radians(angle_deg)
    i, o, p = axes_g(plane, theta)
    one = np.ones(len(field))
    stack = (one, i, i**2, i**3, i * o, i * p, o**2, p**2, field, field**2, i * field, o * field)
    found = dict(zip(NAMES, (*stack, p * field), strict=True))
    turned = axes_g(plane, theta + 0.5 * np.pi)[0] * (plane != "op")
    found.update({"_offset": turned, "_Ko": o, "_Kp": p})
    part = np.linspace(-1.0, 1.0, len(field))
    if case.warming_K:
        found.update({"_K0_T": part, "_Ki_T": i * part})
    if case.drift_V_per_h or case.warm_up_V:
        for order in (1, 2, 3):
            found[f"_drift{order}"] = np.polynomial.legendre.Legendre.basis(order)(part)
    for name in found:
        if name.startswith("_drift") or name.endswith("_T"):
            found[name] = found[name] - (found[name].mean() if name != "_Ki_T" else 0.0)
    return found


def bound(case: Case, kept: tuple[str, ...]) -> Array:
    """Return the bound of each kept coefficient with the nuisance columns beside."""
    table = columns(case)
    design = np.column_stack([table[name] for name in kept])
    for name, column in table.items():
        if name.startswith("_"):
            left = column - design @ np.linalg.lstsq(design, column, rcond=None)[0]
            if np.linalg.norm(left) > 1e-6 * np.sqrt(len(column)):
                design = np.column_stack((design, column))
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.inv((design / scale).T @ (design / scale)) / np.outer(scale, scale)
    return NOISE_V * np.sqrt(np.diag(inverse))[: len(kept)]


def recorded(case: Case, seed: int) -> tuple[AccelerometerDataset, dict[str, float]]:
    """Simulate one record; return it and what K0 and Ki are as their means over its rows."""
    generator = np.random.default_rng([seed, 3])
    plane, angle_deg, field = case.points()
    count = len(field)
    time_s = np.asarray(INTERVAL_S * np.arange(count), dtype=np.float64)
    measured = field + 1e-6 * generator.standard_normal(count)
    theta = np.radians(angle_deg) + case.offset_arcsec * ARCSEC
    drift = case.drift_V_per_h * time_s / 3600.0 - case.warm_up_V * np.exp(-time_s / 1500.0)
    warmer = case.warming_K * (1.0 - np.exp(-time_s / 1500.0))
    i, o, p = axes_g(plane, theta)
    output = output_V(i, o, p, measured) + drift
    output = output + 50e-6 * warmer + 120e-6 * TRUTH["Ki"] * i * warmer
    output = output + NOISE_V * generator.standard_normal(count)
    wild = generator.random(count) < case.outliers
    size = 10.0 ** generator.uniform(-4.0, -1.0, count) * generator.choice([-1.0, 1.0], count)
    output = output + np.where(wild, size, 0.0)
    there = generator.random(count) >= case.missing
    temperature = 23.0 + warmer + 1e-3 * generator.standard_normal(count)
    dataset = AccelerometerDataset(
        time_s=time_s[there],
        plane=plane[there],
        theta_deg=angle_deg[there],
        theta_commanded_deg=angle_deg[there],
        field_T=measured[there],
        field_commanded_T=field[there],
        output_V=output[there],
        temperature_degC=temperature[there],
        evenly_timed=True,
    )
    mean_K = float(warmer[there].mean())
    means = {
        "K0": TRUTH["K0"] + float(drift[there].mean()) + 50e-6 * mean_K,
        "Ki": TRUTH["Ki"] * (1.0 + 120e-6 * mean_K),
    }
    return dataset, means


@cache
def limits(case: Case) -> tuple[Mapping[str, Mapping[str, float]], dict[str, float]]:
    """Return the terms and the bound of each kept coefficient."""
    judged = judge(*case.points())
    return judged.terms, dict(zip(judged.kept, bound(case, judged.kept), strict=True))


def trial(case: Case, seed: int) -> Trial:
    """Analyse one record of a case."""
    dataset, means = recorded(case, seed)
    analysis = analyse(dataset)
    terms, limit = limits(case)
    true = {**TRUTH, **means}
    truth: dict[tuple[str, str | None], float] = {
        (name, None): sum(share * true[part] for part, share in terms[name].items())
        for name in limit
    }
    results = of_estimates(analysis.estimates, truth, limit)
    results |= of_published(analysis.published, truth, limit)
    return Trial(results, frozenset(flag.code for flag in analysis.flags))


def trials() -> Trials:
    """Return what analyses a record of each case."""
    return {case.name: partial(trial, case) for case in CASES}


def measure(case: Case, runs: int) -> dict[str, object]:
    """Run one case."""
    return {"rows": len(case.points()[0]), **measured(partial(trial, case), runs)}


def main() -> None:
    print_cases("Accelerometer estimator against its bound.", CASES, measure)


if __name__ == "__main__":
    main()
