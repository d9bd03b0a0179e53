"""Start a run in a process of its own and kill it at a moment that a seed chooses."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from campaign_helpers import (
    finished_units,
    only_run,
    raw_content,
    whole_events,
)
from command_line import sim_command

STARTING, EVALUATING = 0.1, 0.15
"""Share of the kills before the run has a folder to show, and after its last step."""
LONGEST_START_S, LONGEST_EVALUATION_S = 1.5, 1.5
LOOKS_EVERY_S = 0.001
GIVES_UP_AFTER_S = 120.0


@dataclass(frozen=True)
class Kill:
    """What a kill met: the run's folder if there was one, and when it came."""

    folder: Path | None
    phase: str
    was_running: bool
    unix_s: float
    left: tuple[str, ...] = ()
    """The process numbers of its children, such as its guardian."""


def written_bytes(parent: Path) -> int:
    """Return how many bytes of log and raw data a run has written by now."""
    files = [*parent.glob("[!.]*/events.jsonl"), *parent.glob("[!.]*/raw/*.mcap")]
    return sum(file.stat().st_size for file in files)


def kill_at_random_moment(
    command: list[str],
    parent: Path,
    expected_bytes: int,
    rng: np.random.Generator,
    *,
    longest_delay_s: float = 0.02,
) -> Kill:
    """Start a run that writes below `parent`, kill it, and say what the kill met.

    The moment is drawn: a time after the start, an amount of written data (most of them), or a
    time after all data are written, while they are evaluated. `longest_delay_s` lets a drawn part
    of it pass after the amount is reached, so that the kill does not always follow a write.
    """
    draw = rng.random()
    amount, delay_s = rng.random() * expected_bytes, rng.random()
    if draw < STARTING:
        phase, reached, delay_s = "starting", _always, delay_s * LONGEST_START_S
    elif draw > 1 - EVALUATING:
        phase, delay_s = "evaluating", delay_s * LONGEST_EVALUATION_S
        reached = _written(parent, expected_bytes)
    else:
        phase, delay_s = "measuring", delay_s * longest_delay_s
        reached = _written(parent, amount)
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    wrote, written = time.monotonic(), 0
    while not reached() and process.poll() is None:
        if (now := written_bytes(parent)) != written:
            wrote, written = time.monotonic(), now
        assert time.monotonic() - wrote < GIVES_UP_AFTER_S, "the run writes nothing more"
        time.sleep(LOOKS_EVERY_S)
    time.sleep(delay_s)
    was_running = process.poll() is None
    left = children_of(process.pid)
    unix_s = time.time()
    process.kill()
    process.wait()
    folder = only_run(parent) if parent.is_dir() else None
    return Kill(folder, phase, was_running, unix_s, left)


def children_of(process: int) -> tuple[str, ...]:
    """Return the numbers of a process's children; none where the system does not tell."""
    lists = Path(f"/proc/{process}/task").glob("*/children")
    with suppress(OSError):
        return tuple(child for one in lists for child in one.read_text(encoding="utf-8").split())
    return ()


def guardian_at_work(kill: Kill) -> bool:
    """Whether a child of the killed process still lives."""
    for child in kill.left:
        with suppress(OSError):
            state = Path(f"/proc/{child}/stat").read_text(encoding="utf-8").rpartition(")")[2]
            if state.split()[0] != "Z":
                return True
    return False


def _always() -> bool:
    return True


def _written(parent: Path, amount: float) -> Callable[[], bool]:
    return lambda: written_bytes(parent) >= amount


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


def unfinished_unit(folder: Path) -> str | None:
    """Return the unit of work that was under way when the log ended."""
    begun = [event["unit"] for event in whole_events(folder) if event["event"] == "unit-started"]
    return begun[-1] if begun and begun[-1] not in finished_units(folder) else None


def gyro_rows(folder: Path) -> dict[str, list[np.ndarray]]:
    """Return the recorded blocks of the laser gyro by unit of work."""
    file = folder / "raw" / "gyro_acquisition-000.mcap"
    return raw_content(file).rows if file.is_file() else {}


def lost_real_s(kill: Kill, epoch_unix: float, speed: float) -> float | None:
    """Return how old, in real time, the youngest gyro sample was that a kill left on disk.

    None where no sample of a laser gyro was being recorded. One sample interval is no loss:
    nothing came.
    """
    if kill.folder is None or not kill.was_running:
        return None
    finished, rows = set(finished_units(kill.folder)), gyro_rows(kill.folder)
    recorded = [unit for unit in rows if unit not in finished]
    if not recorded:
        return None
    last_arrival_s = float(rows[recorded[-1]][-1]["arrival_time_s"][-1])
    return kill.unix_s - epoch_unix - last_arrival_s / speed
