"""How much memory the evaluation of a long record takes; one JSON line a case and a kind of work.

python benchmarks/memory_evaluation.py --hours 72 --sample-interval 0.1 --excitation simultaneous

The run folder is written as a run writes it, block by block, by a made-up laser gyro (with spikes
and lost samples); then `station analyse` and `station export` work on it, each in a process of its
own whose largest resident set is measured, beside what `validate` foresaw of the plan.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from figures import Figures
from made_runs import made_run

from station import registry
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures, procedure_of
from station.runner.resources import memory_of


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--sample-interval", type=float, default=0.1)
    parser.add_argument("--axes", default="IA,NA,LA")
    parser.add_argument("--frequency", type=float, default=0.1)
    parser.add_argument("--excitation", default="sequential")
    parser.add_argument("--formats", default="hdf5", help="of `station export`, with commas")
    parser.add_argument("--lost", type=float, default=0.0, help="part of the samples")
    parser.add_argument("--keep", type=Path, help="a folder in which the run folder is left")
    figures = Figures(parser)
    arguments = figures.parse()
    simultaneous = arguments.excitation == "simultaneous"
    frequency = "null" if simultaneous else f"{arguments.frequency} Hz"
    settings = [
        f"parameters.sample_interval={arguments.sample_interval} s",
        f"parameters.duration={arguments.hours} h",
        f"parameters.axes=[{arguments.axes}]",
        f"parameters.excitation={arguments.excitation}",
        f"parameters.frequency={frequency}",
    ]
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    with tempfile.TemporaryDirectory() as parent:
        plan = read_plan(find(PLANS, "rlg-magnetic-sensitivity"), Procedures(), settings)
        foreseen = procedure_of(plan.procedure).forecast(plan.parameters, bench)
        began = time.perf_counter()
        folder = made_run(arguments.keep or Path(parent), plan, bench, lost=arguments.lost)
        name = f"{arguments.hours:g} h, {arguments.excitation}"
        case = {
            "hours": arguments.hours,
            "sample_interval_s": arguments.sample_interval,
            "excitation": arguments.excitation,
            "axes": arguments.axes,
            "foreseen_MB": round(memory_of(foreseen).needed_bytes / 1e6),
            "raw_MB": sum(file.stat().st_size for file in folder.rglob("*.mcap")) // 1_000_000,
        }
        print(f"{folder} made in {time.perf_counter() - began:.0f} s", file=sys.stderr)
        work: list[tuple[object, ...]] = [("analyse", folder)]
        work += [("export", folder, "--format", one) for one in arguments.formats.split(",") if one]
        for verb in work:
            found = measured(verb)
            figures.line(f"{name}: {found['work']}", **case, **found)


def measured(verb: tuple[object, ...]) -> dict[str, Any]:
    """Return the largest resident set and the time of a command of the station."""
    began = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-m", "station", *map(str, verb)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stderr is not None
    said = child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    return {
        "work": " ".join(str(one) for one in verb if not isinstance(one, Path)),
        "exit": os.waitstatus_to_exitcode(status),
        "peak_MB": round(usage.ru_maxrss / 1000),
        "wall_s": round(time.perf_counter() - began, 1),
        "said": said.splitlines()[-1:],
    }


if __name__ == "__main__":
    main()
