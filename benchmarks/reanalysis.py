"""Evaluate copies of one run on one and on two workers of Dask over TCP, and kill a worker.

python benchmarks/reanalysis.py [--runs 1000]

JSON lines: for each number of workers the wall time and runs a second; then how many runs were
evaluated although a worker was killed after a tenth of them. Every row must hold the digest of the
result document that a single evaluation gives.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from made_runs import made_run

from station.cli.validating import read_bench_named, read_plan_for
from station.reanalysis.one_run import rows_of_run
from station.reanalysis.scheduling import evaluated

SHORT = ("parameters.duration=50 s", "parameters.frequency=0.2 Hz")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    count = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as place:
        folders = copies(Path(place), count)
        digest = rows_of_run(folders[0])[0]["results_sha256"]
        for workers in (1, 2):
            print(json.dumps(timed(folders, workers, digest, kills=False)), flush=True)
        print(json.dumps(timed(folders, 2, digest, kills=True)), flush=True)


def copies(place: Path, count: int) -> list[str]:
    bench = read_bench_named("sim")
    run = made_run(place / "made", read_plan_for("rlg-magnetic-sensitivity", bench, SHORT), bench)
    return [str(shutil.copytree(run, place / f"{number:05d}")) for number in range(count)]


def timed(folders: list[str], workers: int, digest: str, *, kills: bool) -> dict[str, object]:
    from distributed import LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        address = str(cluster.scheduler_address)
        for _ in evaluated(folders[: 4 * workers], None, address):
            pass  # the workers have imported what they need
        began_s, done, same = time.perf_counter(), 0, 0
        for rows in evaluated(folders, None, address):
            done += 1
            same += all(row.get("results_sha256") == digest for row in rows)
            if kills and done == len(folders) // 10:
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        wall_s = time.perf_counter() - began_s
    return {
        "benchmark": "reanalysis",
        "workers": workers,
        "killed_workers": int(kills),
        "runs": len(folders),
        "evaluated": done,
        "identical_to_a_single_evaluation": same,
        "wall_s": round(wall_s, 2),
        "runs_per_s": round(done / wall_s, 1),
    }


if __name__ == "__main__":
    main()
