"""The cost of the panel: processor with three viewers, first picture, memory over a long run.

    python benchmarks/panel.py [--seconds 20] [--hours 24 --speed 400]

A run is served by `station sim` and watched through the panel's own process. One JSON line each:
share of a core while three viewers listen at the panel's full rate, seconds from opening a page to
its first state, and the panel's memory at a fifth and at the end of a long run.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from command_line import station_command
from panel_server import free_port
from served_bench import served_bench

from station.record.run_names import runs_below

PLAN = """\
plan: 1
procedure: rlg-magnetic-sensitivity
dut: {{model: RLG-50, serial: SN-1}}
parameters:
  frequency: {frequency}
  amplitude: 1 mT
  sample_interval: {interval}
  duration: {duration}
  axes: [IA]
  pulse_weight: 0.0625 arcsec
  warm_up: {{slope_limit: 10 deg/h^2, window: 1 min, at_most: 5 min}}
"""
VIEWERS = 3
TICKS = os.sysconf("SC_CLK_TCK")


class Viewer(threading.Thread):
    """A browser's stream of events, read as fast as it comes."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self._url = url
        self.first_s: float | None = None
        self.events = 0

    def run(self) -> None:
        """Read until the stream ends."""
        began_s = time.monotonic()
        try:
            with urllib.request.urlopen(self._url, timeout=60) as answer:
                for line in answer:
                    if line.startswith(b"event: state") and self.first_s is None:
                        self.first_s = time.monotonic() - began_s
                    self.events += line.startswith(b"event: ")
        except OSError:  # the panel was ended
            return


@contextmanager
def process(*arguments: str | Path) -> Iterator[subprocess.Popen[bytes]]:
    """A command of the station, ended with the context."""
    null = subprocess.DEVNULL
    one = subprocess.Popen(station_command(*arguments), stdin=null, stdout=null, stderr=null)
    try:
        yield one
    finally:
        one.terminate()
        one.wait(60.0)


@contextmanager
def watched(place: Path, plan: str, speed: float) -> Iterator[tuple[int, str, Path]]:
    """A run that is going on and a panel on it: the panel's process, address, and the run."""
    (place / "plan.yaml").write_text(plan, encoding="utf-8")
    os.environ["XDG_STATE_HOME"] = str(place / "state")  # what trips here concerns no other bench
    runs, port = place / "runs", free_port()
    with served_bench(place, speed=speed) as (at, _):
        run = ("run", place / "plan.yaml", "--served", at, "--non-interactive", "--output", runs)
        with process(*run), process("panel", "--output", runs, "--port", str(port)) as panel:
            until_s = time.monotonic() + 60.0
            while not runs_below(runs) or not answers(port):
                assert time.monotonic() < until_s, "run or panel did not begin"
                time.sleep(0.1)
            yield panel.pid, f"http://127.0.0.1:{port}", runs_below(runs)[-1]


def answers(port: int) -> bool:
    """Whether the panel answers."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5):
            return True
    except OSError:
        return False


def cpu_s(pid: int) -> float:
    """Return the processor time of a process, in s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def memory_MB(pid: int) -> float:
    """Return the resident memory of a process, in MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def load(seconds: float) -> None:
    """Print what three viewers cost at real speed."""
    plan = PLAN.format(frequency="0.1 Hz", interval="0.1 s", duration="1000 s")
    with (
        tempfile.TemporaryDirectory() as place,
        watched(Path(place), plan, 1.0) as (pid, url, run),
    ):
        time.sleep(10.0)
        viewers = [Viewer(f"{url}/api/run/{run.name}/events") for _ in range(VIEWERS)]
        for viewer in viewers:
            viewer.start()
        time.sleep(3.0)
        began_s, before_s = time.monotonic(), cpu_s(pid)
        events = sum(viewer.events for viewer in viewers)
        time.sleep(seconds)
        took_s = time.monotonic() - began_s
        print(
            json.dumps(
                {
                    "benchmark": "panel-load",
                    "viewers": VIEWERS,
                    "core_percent": round(100 * (cpu_s(pid) - before_s) / took_s, 2),
                    "events_per_s": round(
                        (sum(viewer.events for viewer in viewers) - events) / took_s, 1
                    ),
                    "first_state_s": round(max(viewer.first_s or 1e9 for viewer in viewers), 3),
                }
            ),
            flush=True,
        )


def day(hours: float, speed: float) -> None:
    """Print the panel's memory over a long run that goes many times as fast."""
    plan = PLAN.format(frequency="0.05 Hz", interval="1 s", duration=f"{hours:g} h")
    with (
        tempfile.TemporaryDirectory() as place,
        watched(Path(place), plan, speed) as (pid, url, run),
    ):
        viewer = Viewer(f"{url}/api/run/{run.name}/events")
        viewer.start()
        whole_s = hours * 3600.0 / speed
        seen = {}
        for share in (0.2, 0.4, 0.6, 0.8, 1.0):
            time.sleep(0.2 * whole_s)
            seen[f"{share:g}"] = round(memory_MB(pid), 1)
        rows = sum(one.stat().st_size for one in run.rglob("*.mcap"))
        line = {"benchmark": "panel-memory", "hours": hours, "speed": speed, "memory_MB": seen}
        print(json.dumps({**line, "raw_bytes": rows, "viewer_ended": not viewer.is_alive()}))


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--hours", type=float, default=0.0, help="0: no long run")
    parser.add_argument("--speed", type=float, default=400.0)
    chosen = parser.parse_args()
    load(chosen.seconds)
    if chosen.hours:
        day(chosen.hours, chosen.speed)


if __name__ == "__main__":
    main()
