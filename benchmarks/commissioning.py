"""Whether a commissioning names planted faults, and raises no alarm on healthy benches.

    python benchmarks/commissioning.py [--runs 20] [--first 1] [--case NAME]

Each run has a seed of the simulated world and a size of its fault of its own. A healthy bench is
commissioned part by part. One JSON object for each part of a bench and each fault on standard
output: how many runs raised an alarm, or did not name the fault and nothing else, with their seeds
and flags; the wall time of a run.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from commissioning_parts import fitted_parts, whole_plan_of
from commissioning_plants import ALL_PLANTS
from plan_runs import run_of, shipped_bench
from plants import Plant, named

BENCHES = ("sim", "sim-alternate")


@dataclass(frozen=True)
class Case:
    """A part of a bench, healthy or with a planted fault."""

    bench: str
    part: str
    plant: Plant | None = None

    @property
    def name(self) -> str:
        """What is tried."""
        return f"{self.bench} {self.part} {self.plant.name if self.plant else 'healthy'}"


def cases() -> Iterator[Case]:
    """Yield each part of each bench, then each fault on the first one."""
    for bench in BENCHES:
        for part in fitted_parts(bench):
            yield Case(bench, part)
    for plant in ALL_PLANTS:
        yield Case(BENCHES[0], plant.part, plant)


def measure(case: Case, first: int, runs: int) -> dict[str, object]:
    """Try a case at several seeds."""
    wrong, times_s = [], []
    for seed in range(first, first + runs):
        bench = shipped_bench(case.bench)
        bench["simulation"]["seed"] = seed
        rng = random.Random(f"{seed} {case.name}")
        expected = set() if case.plant is None else {case.plant.plant(bench, rng)}
        began_s = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            outcome = run_of(Path(folder), whole_plan_of(case.part, case.bench), bench)
            found = None if outcome.document is None else named(outcome)
        times_s.append(time.perf_counter() - began_s)
        if found != expected or outcome.exit_code != int(bool(expected)):
            said = sorted(map(str, found)) if found is not None else [str(outcome.error)]
            wrong.append({"seed": seed, "exit_code": outcome.exit_code, "found": said})
    return {
        "benchmark": "commissioning",
        "case": case.name,
        "runs": runs,
        "wrong": len(wrong),
        "details": wrong,
        "median_s": round(statistics.median(times_s), 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--case", help="only the cases whose name contains this")
    options = parser.parse_args()
    for case in cases():
        if options.case is None or options.case in case.name:
            print(json.dumps(measure(case, options.first, options.runs)), flush=True)


if __name__ == "__main__":
    main()
