"""Scale factor of a gyro on a rate table: rmse over the Cramér-Rao bound, and coverage.

    python benchmarks/gyro_rate_estimator.py --runs 2000 --case drifting

Records are made in the time domain, the analysis is the station's own. The bound is that of
generalised least squares with noise of known size; where there is none given, u stands for it.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from rate_records import CASES, bounds, trials

PPM = 1e6


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=2000)
    options.add_argument("--case", choices=CASES, action="append")
    given = options.parse_args()
    for case in given.case or CASES:
        began = time.perf_counter()
        found = trials(CASES[case], given.runs)
        bound = bounds(CASES[case]) if CASES[case].repeats == 1 else {}
        each_ms = 1e3 * (time.perf_counter() - began) / given.runs
        print(f"{case}: {given.runs} runs, {each_ms:.0f} ms each")
        for name, one in found.items():
            factor = PPM if name == "scale_factor" else 1.0
            rms = factor * float(np.sqrt(np.mean(one.errors**2)))
            share = f"rmse/CRLB {rms / bound[name]:.2f}, " if name in bound else ""
            typical = rms / (factor * float(np.median(one.u)))
            inside = one.covered.mean()
            print(f"  {name}: {share}rmse {rms:.3g}, rmse/u {typical:.2f}, covered {inside:.1%}")


if __name__ == "__main__":
    main()
