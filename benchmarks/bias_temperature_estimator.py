"""Bias of a gyro over temperature: error over its stated uncertainty, and coverage.

python benchmarks/bias_temperature_estimator.py [--runs 300] [--case fibre-optic]

Records are made in the time domain, the analysis is the station's own. One JSON line a case and
result: rmse, the median u, their ratio, and how often the 95 % interval holds the true value.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from bias_records import CASES, errors_in_u

COVERAGE_FACTOR = 1.96


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--case", choices=CASES, action="append")
    given = parser.parse_args()
    for case in given.case or CASES:
        collected: dict[str, list[tuple[float, float]]] = {}
        for seed in range(given.runs):
            for name, pair in errors_in_u(CASES[case], seed).items():
                collected.setdefault(name, []).append(pair)
        for name, pairs in collected.items():
            error, u = np.array(pairs).T
            line = {
                "benchmark": "bias_temperature_estimator",
                "case": case,
                "result": name,
                "runs": len(error),
                "rmse": float(np.sqrt(np.mean(error**2))),
                "u": float(np.median(u)),
                "rmse_over_u": round(float(np.sqrt(np.mean((error / u) ** 2))), 2),
                "covered": round(float(np.mean(np.abs(error) <= COVERAGE_FACTOR * u)), 3),
            }
            print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
