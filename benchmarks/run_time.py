"""How much faster than the bench a run on the simulated bench is; one JSON line a run.

python benchmarks/run_time.py --plan rlg-magnetic-sensitivity --runs 3
python benchmarks/run_time.py --plan accelerometer-magnetic-sensitivity \
    --set "parameters.planes=[io, ip, op]" --set parameters.order=as_published \
    --set parameters.repeats=1
python benchmarks/run_time.py --plan fog-scale-factor-temperature --runs 1
python benchmarks/run_time.py --plan nine-axis-calibration
python benchmarks/run_time.py --plan nine-axis-calibration --own-threads

`--own-threads` has each simulated instrument answer in its own thread, never in the one that asks.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from figures import Figures

from station import registry
from station.clock.virtual_wire import VirtualWire
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.runner.execute import Request, execute


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plan", default="rlg-magnetic-sensitivity")
    parser.add_argument("--bench", default="sim")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--own-threads", action="store_true")
    figures = Figures(parser)
    arguments = figures.parse()
    if arguments.own_threads:
        setattr(VirtualWire, "attend", lambda wire, attendant: False)  # noqa: B010
    for number in range(arguments.runs):
        with tempfile.TemporaryDirectory() as parent:
            path = find(PLANS, arguments.plan)
            plan = read_plan(path, Procedures(), arguments.overrides)
            bench = read_bench(find(BENCHES, arguments.bench), registry.names(registry.DRIVERS))
            began, worked = time.perf_counter(), time.process_time()
            outcome = execute(Request(plan, bench, Path(parent), quiet=True))
            wall_s, cpu_s = time.perf_counter() - began, time.process_time() - worked
            folder = RunFolder(outcome.folder)
            bench_s, units = folder.events[-1].time_s, len(folder.finished_units())
        line = {
            "own_threads": arguments.own_threads,
            "run": number,
            "exit_code": outcome.exit_code,
            "units": units,
            "bench_s": round(bench_s, 3),
            "wall_s": round(wall_s, 3),
            "processor_s": round(cpu_s, 3),
            "bench_time_over_wall_time": round(bench_s / wall_s, 1),
        }
        figures.line(arguments.plan, **line)


if __name__ == "__main__":
    main()
