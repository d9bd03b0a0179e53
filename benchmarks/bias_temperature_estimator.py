"""Bias of a gyro over temperature: error over its stated uncertainty, and coverage.

python benchmarks/bias_temperature_estimator.py [--runs 300] [--case fibre-optic]

Records are made in the time domain, the analysis is the station's own. One JSON line a result with
the figures of each case: rmse over u, and how often the 95 % interval holds the true value.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from cases import Trial, Trials, of_estimates
from figures import Figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from bias_records import CASES, Gyro, errors_in_u, record, truths

from procedures.gyro_bias_temperature.analysis import analyse

COVERAGE_FACTOR = 1.96


def trial(gyro: Gyro, seed: int) -> Trial:
    """Analyse one record; no bound is known."""
    dataset = record(gyro, seed)
    analysis = analyse(dataset)
    truth: dict[tuple[str, str | None], float] = {
        (name, "IA"): value
        for name, value in truths(gyro, dataset).items()
        if gyro.thermometer or not name.endswith("_lag")
    }
    codes = frozenset(flag.code for flag in analysis.flags)
    return Trial(of_estimates(analysis.estimates, truth), codes)


def trials() -> Trials:
    """Return what analyses a record of each case, by the gyro's thermometer and without it.

    A case of the chamber's thermometer alone that is another one without its own is made once.
    """
    both = {name: gyro for name, gyro in CASES.items() if gyro.thermometer}
    alone = {
        f"{name}, the chamber's thermometer alone": replace(gyro, thermometer=False)
        for name, gyro in both.items()
    }
    others = {
        name: gyro
        for name, gyro in CASES.items()
        if not gyro.thermometer and gyro not in alone.values()
    }
    return {name: partial(trial, gyro) for name, gyro in {**both, **alone, **others}.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--case", choices=CASES, action="append")
    figures = Figures(parser)
    given = figures.parse()
    lines: dict[str, dict[str, float]] = {}
    for case in given.case or CASES:
        collected: dict[str, list[tuple[float, float]]] = {}
        for seed in range(given.runs):
            for name, pair in errors_in_u(CASES[case], seed).items():
                collected.setdefault(name, []).append(pair)
        for name, pairs in collected.items():
            error, u = np.array(pairs).T
            covered = float(np.mean(np.abs(error) <= COVERAGE_FACTOR * u))
            lines.setdefault(name, {})[f"{case} over u"] = round(
                float(np.sqrt(np.mean((error / u) ** 2))), 4
            )
            lines[name][f"{case} covered"] = round(covered, 4)
    for name, line in lines.items():
        figures.line(name, runs=given.runs, **line)


if __name__ == "__main__":
    main()
