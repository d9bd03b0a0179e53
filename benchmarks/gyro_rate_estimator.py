"""Scale factor of a gyro on a rate table: rmse over the Cramér-Rao bound, and coverage.

    python benchmarks/gyro_rate_estimator.py --runs 2000 --case drifting

Records are made in the time domain, the analysis is the station's own. The bound is that of
generalised least squares with noise of known size; several switch-ons have none. One JSON object a
case; sizes of scale factor, asymmetry and nonlinearity in ppm. The three axes of a nine-axis sensor
and of a navigator, each up in turn, are analysed one by one: a dataset is one of them.
"""

from __future__ import annotations

import argparse
import sys
from functools import cache, partial
from pathlib import Path

import numpy as np
from cases import Trial, Trials, of_estimates
from figures import Figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import rate_records
from rate_records import CASES, Gyro, bounds, made

from procedures.gyro_rate_table.analysis import analyse

PPM = 1e6


known_bounds = cache(bounds)


def trial(gyro: Gyro, seed: int) -> Trial:
    """Analyse the records of one gyro."""
    case = made(np.random.default_rng((seed, 1)), gyro)
    analysis = analyse(case.dataset)
    truth: dict[tuple[str, str | None], float] = {
        (name, "IA"): value for name, value in case.truth.items()
    }
    limit = dict(known_bounds(gyro)) if gyro.repeats == 1 else {}
    if limit:
        limit["scale_factor"] /= PPM
    codes = frozenset(flag.code for flag in analysis.flags)
    return Trial(of_estimates(analysis.estimates, truth, limit), codes)


def trials() -> Trials:
    """Return what analyses the records of each case."""
    return {name: partial(trial, gyro) for name, gyro in CASES.items()}


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=2000)
    options.add_argument("--case", choices=CASES, action="append")
    figures = Figures(options)
    given = figures.parse()
    for case in given.case or CASES:
        found = rate_records.trials(CASES[case], given.runs)
        bound = bounds(CASES[case]) if CASES[case].repeats == 1 else {}
        line: dict[str, object] = {"runs": given.runs}
        for name, one in found.items():
            factor = PPM if name == "scale_factor" else 1.0
            rms = factor * float(np.sqrt(np.mean(one.errors**2)))
            line[f"{name}_rmse"] = float(f"{rms:.4g}")
            if name in bound:
                line[f"{name}_over_bound"] = round(rms / bound[name], 4)
            line[f"{name}_over_u"] = round(rms / (factor * float(np.median(one.u))), 4)
            line[f"{name}_covered"] = round(float(one.covered.mean()), 4)
        figures.line(case, **line)


if __name__ == "__main__":
    main()
