"""What a step and an event cost beside the disk's own time; one JSON line a case.

python benchmarks/step_overhead.py

A step writes two events; each is with the operating system before the step goes on and survives
the death of the process. The loss of power is covered to the last finished unit of work: there
the disk is waited for, and the disk's own `fdatasync` of as many bytes is measured beside it.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaign_helpers import undirected_run

from station.clock import VirtualClock
from station.record.folder import RunRecord
from station.runner.progress import Progress


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=None, help="On the disk to measure.")
    parser.add_argument("--times", type=int, default=1000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as parent:
        clock = VirtualClock()
        record = RunRecord(Path(parent), "step-overhead", "SN-1", clock)
        run = undirected_run(clock, record, Progress(1.0, quiet=True))
        alone = os.open(Path(parent) / "alone", os.O_WRONLY | os.O_CREAT | os.O_APPEND)

        def a_step() -> None:
            run.do("S1", "Do nothing", 0.0, lambda run: None)

        def sync_alone() -> None:
            os.write(alone, b"x" * 200)
            os.fdatasync(alone)

        cases: dict[str, tuple[Callable[[], object], int]] = {
            "step with its two events": (a_step, arguments.times),
            "event": (lambda: record.event("e", durable=False, n=1), arguments.times),
            "event on disk": (lambda: record.event("e", n=1), arguments.times // 5),
            "unit finished": (lambda: record.finish_unit("unit"), arguments.times // 5),
            "fdatasync alone": (sync_alone, arguments.times // 5),
        }
        for name, (act, times) in cases.items():
            print(json.dumps({"benchmark": "step_overhead", "case": name, **timed(act, times)}))
        record.close()
        os.close(alone)


def timed(act: Callable[[], object], times: int) -> dict[str, float]:
    took_ms = []
    for _ in range(times):
        began = time.perf_counter()
        act()
        took_ms.append(1e3 * (time.perf_counter() - began))
    return {
        "times": times,
        "median_ms": round(statistics.median(took_ms), 4),
        "p95_ms": round(statistics.quantiles(took_ms, n=20)[-1], 4),
    }


if __name__ == "__main__":
    main()
