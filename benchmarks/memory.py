"""How much memory a day of acquisition takes; one JSON line an hour, then the growth.

python benchmarks/memory.py --hours 24

On virtual time the pulse board and the gaussmeter are recorded through their drivers while a coil
is driven and a participant asks its supply every second. `growth_kB_per_h` is the slope of the
resident set over the second half: the first has caches to fill.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, cast

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaign_helpers import PROCEDURE, undirected_run

from sim_instruments.bench import SimulatedBench
from station.clock import VirtualClock
from station.files.lookup import BENCHES, find
from station.instruments.bench import read_bench
from station.instruments.opening import open_instruments
from station.method.duration import NO_TIME
from station.method.verbs import Recording
from station.record.folder import RunRecord
from station.registry import DRIVERS, names
from station.runner.progress import Progress

HOUR_S = 3600.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=24)
    parser.add_argument("--sample-interval", type=float, default=0.1)
    arguments = parser.parse_args()
    resident_kB = []
    with tempfile.TemporaryDirectory() as parent:
        for line in hours(Path(parent), arguments.hours, arguments.sample_interval):
            resident_kB.append(line["resident_kB"])
            print(json.dumps({"benchmark": "memory", **line}), flush=True)
    half = len(resident_kB) // 2
    late = resident_kB[half:]
    slope = float(np.polyfit(np.arange(len(late)), late, 1)[0]) if len(late) > 1 else 0.0
    line = {
        "benchmark": "memory",
        "hours": arguments.hours,
        "first_kB": resident_kB[0],
        "last_kB": resident_kB[-1],
        "growth_kB_per_h": round(slope, 1),
    }
    print(json.dumps(line))


def hours(parent: Path, count: int, sample_interval_s: float) -> Any:
    """Yield, after each hour of bench time, the resident memory and what was recorded."""
    clock = VirtualClock()
    bench = read_bench(find(BENCHES, "sim"), names(DRIVERS))
    simulated = SimulatedBench(bench.data, clock, PROCEDURE)
    addresses = {name: one["address"] for name, one in simulated.instruments.items()}
    record = RunRecord(parent, "memory", "SN-1", clock)
    wanted = ("coil_supply.x", "gaussmeter", "gyro_acquisition")
    with clock.participant("run"), Progress(1.0, quiet=True) as progress:
        found = open_instruments(bench, wanted, addresses, clock, None)
        supply, gaussmeter, board = (cast(Any, found[name].instrument) for name in wanted)
        run = undirected_run(clock, record, progress)
        run.instruments = {name: found[name].instrument for name in wanted}
        simulated.act("dut-power-on")
        supply.programme_limits()
        supply.load_sine(0.1, 1.0)
        gaussmeter.start(2.0)
        board.start(sample_interval_s, 1)
        supply.start_sine()

        def watch() -> None:
            while True:
                clock.sleep(1.0)
                supply.read_safety()

        watcher = clock.start("watch", watch)
        for hour in range(1, count + 1):
            began, end_s = time.perf_counter(), clock.now() + HOUR_S

            def enough(_: object, end_s: float = end_s) -> bool:
                return clock.now() >= end_s

            Recording(run, "day", {"gyro_acquisition": None, "gaussmeter": None}).until(
                enough, takes=NO_TIME
            )
            yield {
                "hour": hour,
                "resident_kB": resident_kB(),
                "recorded_kB": sum(f.stat().st_size for f in record.path.rglob("*.mcap")) // 1024,
                "wall_s": round(time.perf_counter() - began, 2),
            }
        clock.stop()
        watcher.join(10.0)
    for one in found.values():
        one.instrument.close()
    simulated.close()
    record.close()


def resident_kB() -> int:
    """Return the memory that this process holds now (Linux)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * os.sysconf("SC_PAGESIZE") // 1024


if __name__ == "__main__":
    main()
