"""Whether the same run gives the same bytes every time; one JSON line a repetition, then a count.

python benchmarks/determinism.py --repetitions 20

Two runs: the shipped plan with its results, and four streams beside two participants that ask
instruments at their own periods.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaign_helpers import PROCEDURE, file_hashes, four_streams

from station import registry
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.runner.execute import Request, execute


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--plan", default=PROCEDURE)
    arguments = parser.parse_args()

    def shipped_plan(parent: Path) -> dict[str, str]:
        plan = read_plan(find(PLANS, arguments.plan), Procedures())
        bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
        outcome = execute(Request(plan, bench, parent, quiet=True))
        assert outcome.error is None, outcome.error
        return file_hashes(outcome.folder, "results.json")

    def streams(parent: Path) -> dict[str, str]:
        return file_hashes(four_streams(parent, duration_s=300.0))

    for name, run in {arguments.plan: shipped_plan, "four-streams": streams}.items():
        repeat(name, run, arguments.repetitions)


def repeat(name: str, run: Callable[[Path], dict[str, str]], repetitions: int) -> None:
    seen: list[dict[str, str]] = []
    for number in range(repetitions):
        with tempfile.TemporaryDirectory() as parent:
            began = time.perf_counter()
            seen.append(run(Path(parent)))
        differing = [file for file in seen[0] if seen[-1].get(file) != seen[0][file]]
        line = {
            "benchmark": "determinism",
            "run": name,
            "repetition": number,
            "files": len(seen[-1]),
            "differing": differing,
            "wall_s": round(time.perf_counter() - began, 2),
        }
        print(json.dumps(line), flush=True)
    different = len({json.dumps(hashes, sort_keys=True) for hashes in seen})
    count = {"repetitions": repetitions, "different": different}
    print(json.dumps({"benchmark": "determinism", "run": name, **count}), flush=True)


if __name__ == "__main__":
    main()
