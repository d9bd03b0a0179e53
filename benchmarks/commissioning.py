"""Whether a commissioning names planted faults, and raises no alarm on healthy benches.

    python benchmarks/commissioning.py [--healthy 50] [--faults 20] [--first 1] [--case NAME]

A healthy bench is commissioned as `station commission` does it, whole. A fault is looked for by the
part that must name it, and nothing else may be named. Each run has its own seed of the simulated
world and its own size of the fault. One JSON object for each bench and each fault on standard
output: how many runs raised an alarm, or did not name the fault and nothing else, with their seeds
and flags; the wall time of a run.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from commissioning_parts import bench_plan_of, whole_plan_of
from commissioning_plants import ALL_PLANTS
from plan_runs import run_of, shipped_bench
from plants import BOTH, Plant, is_named, named

from station.runner.outcome import Outcome


@dataclass(frozen=True)
class Case:
    """A whole bench that is healthy, or one with a planted fault."""

    bench: str
    plant: Plant | None = None

    @property
    def name(self) -> str:
        """What is tried."""
        return f"{self.bench} {self.plant.name if self.plant else 'healthy'}"


def cases() -> Iterator[Case]:
    """Yield each fault on each bench that has what it needs, then the healthy benches."""
    for plant in ALL_PLANTS:
        for bench in plant.benches:
            yield Case(bench, plant)
    for bench in BOTH:
        yield Case(bench)


def commission(case: Case, seed: int, folder: Path) -> tuple[bool, Outcome]:
    """Run a case at a seed; returns whether it came out as it should."""
    bench = shipped_bench(case.bench)
    bench["simulation"]["seed"] = seed
    if case.plant is None:
        outcome = run_of(folder, bench_plan_of(case.bench), bench)
        return outcome.exit_code == 0 and named(outcome) == set(), outcome
    expected = case.plant.plant(bench, random.Random(f"{seed} {case.name}"))
    outcome = run_of(folder, whole_plan_of(case.plant.part, case.bench), bench)
    return is_named(outcome, expected), outcome


def measure(case: Case, first: int, runs: int) -> dict[str, object]:
    """Try a case at several seeds."""
    wrong, times_s = [], []
    try:
        for seed in range(first, first + runs):
            began_s = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                right, outcome = commission(case, seed, Path(folder))
                flags = [] if outcome.document is None else sorted(map(str, named(outcome)))
            times_s.append(time.perf_counter() - began_s)
            if not right:
                said = {"flags": flags, "error": outcome.error}
                wrong.append({"seed": seed, "exit_code": outcome.exit_code, **said})
    except KeyboardInterrupt:
        pass
    return {
        "benchmark": "commissioning",
        "case": case.name,
        "runs": len(times_s),
        "wrong": len(wrong),
        "details": wrong,
        "median_s": round(statistics.median(times_s), 2) if times_s else None,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--healthy", type=int, default=50, help="runs of each healthy bench")
    parser.add_argument("--faults", type=int, default=20, help="runs of each fault")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--case", default="", help="only the cases whose name contains this")
    options = parser.parse_args()
    for case in cases():
        runs = options.faults if case.plant else options.healthy
        if options.case in case.name and runs:
            print(json.dumps(measure(case, options.first, runs)), flush=True)


if __name__ == "__main__":
    main()
