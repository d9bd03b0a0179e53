"""Noise coefficients of a gyro at rest: rmse over the Cramér-Rao bound, and coverage.

    python benchmarks/gyro_static_estimator.py --runs 2000 --device FOG

Records are made in the time domain, the analysis is the station's own. The bound is that of the
squares Q², N², B², K² with ramp and known rounding. Values below one: squares are not below zero.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from static_records import DEVICES, bound_of_squares, measured_squares

NAMES = ("Q", "N", "B", "K", "R")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=2000)
    options.add_argument("--samples", type=int, default=14_400)
    options.add_argument("--device", choices=DEVICES, action="append")
    given = options.parse_args()
    for device in given.device or DEVICES:
        began = time.perf_counter()
        found = measured_squares(DEVICES[device], given.runs, given.samples)
        bound = bound_of_squares(DEVICES[device], given.samples)
        each_ms = 1e3 * (time.perf_counter() - began) / given.runs
        print(f"{device}: {given.runs} runs of {given.samples} samples, {each_ms:.0f} ms each")
        rms = np.sqrt(np.mean(found.errors**2, axis=0))
        for n, name in enumerate(NAMES):
            share, typical = rms[n] / bound[n], np.median(found.u[:, n]) / bound[n]
            inside = found.covered[:, n].mean()
            print(f"  {name}: rmse/CRLB {share:.2f}, u/CRLB {typical:.2f}, covered {inside:.1%}")
        print(f"  lines seen in pure noise: {found.lines}")


if __name__ == "__main__":
    main()
