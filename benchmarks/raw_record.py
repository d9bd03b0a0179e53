"""How fast sample rows go to a raw file and what they take there; one JSON line a block size.

python benchmarks/raw_record.py
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from figures import Figures

from station.record.raw import RawFile
from station.roles.base import ARRIVAL

CHANNELS = 8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=2_000_000)
    figures = Figures(parser)
    arguments = figures.parse()
    names = [f"channel_{number}" for number in range(CHANNELS)]
    for block in (10, 100, 1000, 10_000):
        rows = np.zeros(block, dtype=[*((name, np.float64) for name in names), (ARRIVAL, float)])
        blocks = max(min(arguments.rows // block, 20_000), 1)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "rows.mcap"
            file = RawFile(path, "benchmark", dict.fromkeys(names, "1"))
            began, worked = time.perf_counter(), time.process_time()
            for _ in range(blocks):
                file.write("unit", rows)
            file.sync()
            took_s, worked_s = time.perf_counter() - began, time.process_time() - worked
            file.close()
            size = path.stat().st_size
        line = {
            "channels": CHANNELS,
            "rows_per_s": round(blocks * block / took_s),
            "us_per_block": round(took_s / blocks * 1e6, 1),
            "processor_us_per_block": round(worked_s / blocks * 1e6, 1),
            "bytes_beside_rows_per_block": round(size / blocks - rows.nbytes),
        }
        figures.line(f"{block} rows a block", **line)


if __name__ == "__main__":
    main()
