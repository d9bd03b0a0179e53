"""A served bench whose world can be asked, and small runs under a guardian to end on it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaign_helpers import only_run, whole_events
from command_line import sim_command
from places import ROOT

SCRIPT = Path(__file__).parent / "guarded_run.py"
GIVES_UP_AFTER_S = 90.0
NEAR_ZERO_A = 0.02
ENVIRONMENT_OF_OURS = {"PYTHONPATH": str(ROOT)}


@dataclass
class World:
    """A simulated bench in another process, and its own account of what is energised."""

    process: subprocess.Popen[str]
    head: Path
    speed: float
    epoch_unix: float

    def report(self) -> dict[str, Any]:
        """Ask the simulated world for its state; no instrument is asked."""
        assert self.process.stdin is not None and self.process.stderr is not None
        self.process.stdin.write("report\n")
        self.process.stdin.flush()
        for line in self.process.stderr:
            if line.startswith("{"):
                state: dict[str, Any] = json.loads(line)
                return state
        raise AssertionError("the simulated bench has ended")

    def inject(self, **fault: Any) -> None:
        """Bring a fault into the bench."""
        assert self.process.stdin is not None and self.process.stderr is not None
        self.process.stdin.write(json.dumps(fault) + "\n")
        self.process.stdin.flush()
        said = self.process.stderr.readline()
        if said.startswith("serving"):  # its first word, where nothing was asked yet
            said = self.process.stderr.readline()
        assert "injected at" in said, said

    def bench_s(self, unix_s: float) -> float:
        """Return the bench time of a moment."""
        return (unix_s - self.epoch_unix) * self.speed

    def at_rest(self, axes: str | None = None) -> bool:
        """Whether the supplies of these coils are off and the coils carry no current.

        Without `axes`: whether nothing at all that can harm is energised.
        """
        state = self.report()
        coils = state["coils"] if axes is None else {axis: state["coils"][axis] for axis in axes}
        of_axes = [f"coil_supply.{axis}" for axis in coils]
        off = not any(
            state["outputs"][one] for one in (state["outputs"] if axes is None else of_axes)
        )
        return off and all(abs(one["current_A"]) < NEAR_ZERO_A for one in coils.values())


@contextmanager
def world(
    folder: Path,
    speed: float = 1.0,
    bench: str = "sim",
    procedure: str = "rlg-magnetic-sensitivity",
) -> Iterator[World]:
    """Serve a simulated bench until exit."""
    head = folder / "served.json"
    with head.open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            sim_command(bench, "--speed", speed, "--procedure", procedure),
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
    try:
        until(lambda: head.read_text(encoding="utf-8").endswith("\n") or process.poll() is not None)
        assert process.poll() is None, "the bench is not served"
        clock = json.loads(head.read_text(encoding="utf-8").splitlines()[0])["clock"]
        yield World(process, head, float(clock["speed"]), float(clock["epoch_unix"]))
    finally:
        process.kill()
        process.communicate()


@dataclass
class GuardedRun:
    """A run under a guardian, its coils energised; standard error is the guardian's, too."""

    process: subprocess.Popen[str]
    folder: Path

    def end_by(self, number: signal.Signals) -> float:
        """End or stop the run's process and return the Unix time of it."""
        unix_s = time.time()
        self.process.send_signal(number)
        return unix_s

    def wait_for_guardian(self) -> str:
        """Wait until the run is dead and its guardian has ended; return what both said."""
        _, said = self.process.communicate(timeout=GIVES_UP_AFTER_S)
        return said

    @property
    def guardians(self) -> list[int]:
        """The processes that watch the run, the first guardian first."""
        children = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        found = [int(one) for path in children for one in path.read_text(encoding="utf-8").split()]
        return sorted((one for one in found if is_alive(one)), key=rank_of)

    def events(self, kind: str) -> list[dict[str, Any]]:
        """Return the events of one kind in the run's own log."""
        return [event for event in whole_events(self.folder) if event["event"] == kind]

    def safe_states(self) -> list[dict[str, bool]]:
        """Return which instruments the guardian had verified, attempt by attempt."""
        log = self.folder / "guardian.jsonl"
        said = self.guardian_log() if log.is_file() else []
        return [
            {one["instrument"]: one["verified"] for one in event["outcomes"]}
            for event in said
            if event["event"] == "safe-state"
        ]

    def made_safe(self) -> dict[str, Any]:
        """Return the last that the guardian noted of the safe state."""
        return [one for one in self.guardian_log() if one["event"] == "safe-state"][-1]

    def guardian_log(self) -> list[dict[str, Any]]:
        """Return the events of the guardian."""
        log = self.folder / "guardian.jsonl"
        return [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]


def start_run(
    world: World,
    parent: Path,
    *coils: str,
    frequency_Hz: float = 0.5,
    amplitude_A: float = 5.0,
) -> GuardedRun:
    """Start a run that drives sines through coils, and wait until it does."""
    what = (world.head, parent, frequency_Hz, amplitude_A, *(coils or ("coil_supply.x",)))
    process = subprocess.Popen(
        [sys.executable, str(SCRIPT), *map(str, what)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        env={**os.environ, **ENVIRONMENT_OF_OURS},
    )
    assert process.stdout is not None
    if process.stdout.readline() != "energised\n":
        raise AssertionError(process.communicate()[1])
    folder = only_run(parent)
    assert folder is not None
    return GuardedRun(process, folder)


def until(true: Any, within_s: float = GIVES_UP_AFTER_S) -> float:
    """Wait until something is true, and return how long that took."""
    began = time.monotonic()
    while not true():
        assert time.monotonic() - began < within_s, "what is waited for did not come"
        time.sleep(0.01)
    return time.monotonic() - began


def is_alive(pid: int) -> bool:
    """Whether a process lives; one that is stopped does."""
    with suppress(OSError):
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2]
        return state.split()[0] not in "ZX"
    return False


def rank_of(guardian: int) -> int:
    """Return which guardian of its run a process is."""
    said = Path(f"/proc/{guardian}/cmdline").read_text(encoding="utf-8").rstrip("\0")
    return ("first", "second").index(said.rpartition("\0")[2])
