"""Noise coefficients of a gyro at rest: rmse over the Cramér-Rao bound, and coverage.

    python benchmarks/gyro_static_estimator.py --runs 2000 --device FOG

Records are made in the time domain, the analysis is the station's own. The bound is that of the
squares Q², N², B², K² with ramp and known rounding. Values below one: squares are not below zero.
One JSON object a device.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from figures import Figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from static_records import DEVICES, bound_of_squares, measured_squares

NAMES = ("Q", "N", "B", "K", "R")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=2000)
    options.add_argument("--samples", type=int, default=14_400)
    options.add_argument("--device", choices=DEVICES, action="append")
    figures = Figures(options)
    given = figures.parse()
    for device in given.device or DEVICES:
        found = measured_squares(DEVICES[device], given.runs, given.samples)
        bound = bound_of_squares(DEVICES[device], given.samples)
        rms = np.sqrt(np.mean(found.errors**2, axis=0))
        line: dict[str, object] = {"runs": given.runs, "samples": given.samples}
        for n, name in enumerate(NAMES):
            line[f"{name}_over_bound"] = round(float(rms[n] / bound[n]), 4)
            line[f"{name}_u_over_bound"] = round(float(np.median(found.u[:, n]) / bound[n]), 4)
            line[f"{name}_covered"] = round(float(found.covered[:, n].mean()), 4)
        figures.line(device, **line, lines_seen_in_pure_noise=found.lines)


if __name__ == "__main__":
    main()
