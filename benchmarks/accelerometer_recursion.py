"""The finite-memory recursion over a long record: how exact, and what a row costs.

    python benchmarks/accelerometer_recursion.py [--samples 1000000]

Walks a record of the published plan, again and again, through the finite memory and holds it
against the QR solution of the same window at 50 places, each just before a window is solved anew.
One JSON object for each of two window lengths: the largest relative difference of a coefficient and
the processor time of a row in the first and in the last tenth of the record.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from figures import Figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from accelerometer_estimator import Case, columns
from accelerometer_records import NOISE_V, TRUTH

from procedures.accelerometer_magnetic_sensitivity.finite_memory import FiniteMemory, column_scale
from procedures.accelerometer_magnetic_sensitivity.model import judge


def recursion(samples: int) -> Iterator[tuple[int, dict[str, object]]]:
    """Walk a long record through finite memories; compare with QR at 50 places."""
    case = Case("long")
    kept = judge(*case.points()).kept
    table = columns(case)
    cycle = np.column_stack([table[name] for name in kept])
    truth = np.array([TRUTH[name] for name in kept])
    generator = np.random.default_rng(0)
    for window in (len(cycle), 8 * len(cycle)):
        memory = FiniteMemory(column_scale(cycle), window)
        recent = np.zeros(window)
        worst, seconds = 0.0, []
        tenth = max(samples // 10, 1)
        # Compared just before the window is solved anew, where rounding is largest.
        places = {window * k - 1 for k in np.linspace(3, samples // window, 50).astype(int)}
        for n in range(samples):
            if n % tenth == 0:
                start = time.process_time()
            row = cycle[n % len(cycle)]
            value = float(row @ truth + NOISE_V * generator.standard_normal())
            recent[n % window] = value
            memory.push(row, value)
            if n in places and memory.estimate is not None:
                rows = cycle[np.arange(n + 1 - window, n + 1) % len(cycle)]
                data = recent[np.arange(n + 1 - window, n + 1) % window]
                scale = column_scale(rows)
                q, r = np.linalg.qr(rows / scale)
                exact = np.linalg.solve(r, q.T @ data)
                exact = (exact + np.linalg.solve(r, q.T @ (data - rows / scale @ exact))) / scale
                worst = max(worst, float(np.max(np.abs(memory.estimate / exact - 1.0))))
            if n % tenth == tenth - 1:
                seconds.append(time.process_time() - start)
        yield (
            window,
            {
                "samples": samples,
                "largest_relative_difference": float(f"{worst:.2g}"),
                "first_tenth_us_a_sample": round(1e6 * seconds[0] / tenth, 1),
                "last_tenth_us_a_sample": round(1e6 * seconds[-1] / tenth, 1),
                "windows_lost": memory.lost,
                "solved_anew": memory.resolved,
            },
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="The finite-memory recursion on a long record.")
    parser.add_argument("--samples", type=int, default=1_000_000)
    figures = Figures(parser)
    for window, found in recursion(figures.parse().samples):
        figures.line(f"window of {window} rows", **found)


if __name__ == "__main__":
    main()
