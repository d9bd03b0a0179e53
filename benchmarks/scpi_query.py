"""A query through a driver's line against the same query by bare PyVISA; JSON lines.

python benchmarks/scpi_query.py

The instrument is the simulated gaussmeter of `station sim` in another process, on real time. Both
ask in turns, in one run, each over a connection of its own.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pyvisa

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from served_bench import served_bench

from drivers.transport.text_line import VisaLine
from station.clock import RealClock
from station.instruments.opening import InstrumentPlace

QUESTIONS = {"gaussmeter": ("*IDN?", "\r\n"), "coil_supply.x": ("MEAS:CURR?", "\n")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--queries", type=int, default=50)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, served_bench(Path(folder), 1.0) as (head, _):
        instruments = json.loads(head.read_text(encoding="utf-8"))["instruments"]
        for name, (question, answer_end) in QUESTIONS.items():
            address = instruments[name]["address"]
            line = VisaLine(InstrumentPlace(name, address, RealClock()), answer_end=answer_end)
            bare = pyvisa.ResourceManager("@py").open_resource(
                address, read_termination=answer_end, write_termination="\n"
            )
            ours, theirs = [], []
            for _ in range(arguments.rounds):
                ours += timed(line.query, question, arguments.queries)
                theirs += timed(bare.query, question, arguments.queries)
            report(name, question, ours, theirs)
            line.close()
            bare.close()


def timed(ask: Callable[[str], str], question: str, queries: int) -> list[float]:
    took_ms = []
    for _ in range(queries):
        began = time.perf_counter()
        ask(question)
        took_ms.append(1e3 * (time.perf_counter() - began))
    return took_ms


def report(name: str, question: str, ours: list[float], theirs: list[float]) -> None:
    medians = statistics.median(ours), statistics.median(theirs)
    line = {
        "benchmark": "scpi_query",
        "instrument": name,
        "question": question,
        "queries": len(ours),
        "driver_line_median_ms": round(medians[0], 4),
        "bare_pyvisa_median_ms": round(medians[1], 4),
        "ratio": round(medians[0] / medians[1], 3),
        "ratio_of_means": round(statistics.fmean(ours) / statistics.fmean(theirs), 3),
    }
    print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
