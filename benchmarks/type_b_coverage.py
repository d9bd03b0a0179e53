"""Coverage of the whole uncertainty, type A and type B: every stated input is drawn.

    python benchmarks/type_b_coverage.py [--runs 2000] [--case gyro] [--processes 1]

Each run makes fresh data of known truth, lets every input deviate as its uncertainty says, through
the data where it acts on them, and analyses the whole. One JSON object a procedure: how often
value ± U held the truth, of all results that have one and of the least covered, the mean square of
error / u, the share of results left undetermined. Where an analysis takes longer than half a second
a quarter of the runs is made.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from functools import partial
from pathlib import Path

# Matrices of a hundred rows gain nothing from threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from figures import Figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from known_findings import KNOWN, errors_of

SLOW_S, SLOW_SHARE = 0.5, 4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--case", help="only the procedures whose name contains this")
    parser.add_argument("--processes", type=int, default=1)
    figures = Figures(parser)
    options = figures.parse()
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        for procedure in KNOWN:
            if options.case is None or options.case in procedure:
                began_s = time.process_time()
                errors_of(procedure, 0)
                slow = time.process_time() - began_s > 2.0 * SLOW_S
                runs = options.runs // (SLOW_SHARE if slow else 1)
                every = pool.map(partial(errors_of, procedure), range(runs))
                figures.line(procedure, runs=runs, **summary(every))


def summary(every: list[dict[str, tuple[float, bool]]]) -> dict[str, object]:
    """Return the figures of all runs; errors in u, NaN of what is left undetermined."""
    names = dict.fromkeys(name for own in every for name in own)
    covered, square = dict[str, float](), dict[str, float]()
    undetermined = 0
    for name in names:
        rows = [own[name] for own in every if name in own]
        errors = np.array([error for error, _ in rows])
        there = np.isfinite(errors)
        undetermined += int((~there).sum())
        if there.any():
            covered[name] = float(np.mean([inside for _, inside in rows], where=there))
            square[name] = float(np.mean(errors**2, where=there))
    least = min(covered, key=lambda name: covered[name])
    return {
        "results": len(covered),
        "coverage_95": round(float(np.mean([*covered.values()])), 4),
        "least_covered": round(covered[least], 4),
        "least": least,
        "mean_square": round(float(np.mean([*square.values()])), 3),
        "undetermined": round(undetermined / sum(len(own) for own in every), 4),
    }


if __name__ == "__main__":
    main()
