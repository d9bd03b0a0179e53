"""Whether a commissioning names planted faults, and raises no alarm on healthy benches.

    python benchmarks/commissioning.py [--healthy 50] [--faults 20] [--pairs 0] [--first 1]
        [--case NAME]

A healthy bench is commissioned as `station commission` does it, whole. A fault is looked for by the
part that must name it, and nothing else may be named. Each run has its own seed of the simulated
world and its own size of the fault. One JSON object for each bench and each fault on standard
output: how many runs raised an alarm, or did not name the fault and nothing else, with their seeds
and flags; the wall time of a run.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaigns.planted.commissioning import Case, cases, commission, named, pair


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


def measure_pairs(first: int, runs: int) -> dict[str, object]:
    """Try two faults at a time on one bench, drawn by seed, with short records."""
    wrong = []
    for seed in range(first, first + runs):
        case: Case = pair(seed)
        with tempfile.TemporaryDirectory() as folder:
            right, outcome = commission(case, seed, Path(folder), short=True)
            flags = [] if outcome.document is None else sorted(map(str, named(outcome)))
        if not right:
            said = {"flags": flags, "error": outcome.error}
            wrong.append({"seed": seed, "case": case.name, **said})
    return {"benchmark": "commissioning-pairs", "runs": runs, "wrong": len(wrong), "details": wrong}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--healthy", type=int, default=50, help="runs of each healthy bench")
    parser.add_argument("--faults", type=int, default=20, help="runs of each fault")
    parser.add_argument("--pairs", type=int, default=0, help="two faults at a time, drawn by seed")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--case", default="", help="only the cases whose name contains this")
    options = parser.parse_args()
    for case in cases():
        runs = options.faults if case.plant else options.healthy
        if options.case in case.name and runs:
            print(json.dumps(measure(case, options.first, runs)), flush=True)
    if options.pairs:
        print(json.dumps(measure_pairs(options.first, options.pairs)), flush=True)


if __name__ == "__main__":
    main()
