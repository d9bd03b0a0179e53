"""Processor time of `station --help`; one JSON line.

python benchmarks/help_time.py
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys


def processor_s(command: list[str]) -> float:
    """Return user and system time of one run of a command."""
    before = os.times()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    after = os.times()
    return (after.children_user + after.children_system) - (
        before.children_user + before.children_system
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    arguments = parser.parse_args()
    command = [sys.executable, "-m", "station", "--help"]
    processor_s(command)
    times = [processor_s(command) for _ in range(arguments.runs)]
    line = {
        "benchmark": "help_time",
        "runs": arguments.runs,
        "processor_ms_median": round(1e3 * statistics.median(times), 1),
        "processor_ms_max": round(1e3 * max(times), 1),
    }
    print(json.dumps(line))


if __name__ == "__main__":
    main()
