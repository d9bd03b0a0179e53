"""A simulated bench that another process serves."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from command_line import sim_command


@contextmanager
def served_bench(
    folder: Path,
    speed: float,
    bench: str = "sim",
    procedure: str = "rlg-magnetic-sensitivity",
) -> Iterator[tuple[Path, float]]:
    """Serve a simulated bench in another process; yield the file `--served` takes and its epoch."""
    head = folder / "served.json"
    with head.open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            sim_command(bench, "--speed", speed, "--procedure", procedure),
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.DEVNULL,
        )
    try:
        while not head.read_text(encoding="utf-8").endswith("\n"):
            assert process.poll() is None, "the bench is not served"
            time.sleep(0.01)
        clock = json.loads(head.read_text(encoding="utf-8").splitlines()[0])["clock"]
        yield head, float(clock["epoch_unix"])
    finally:
        process.kill()
        process.wait()
