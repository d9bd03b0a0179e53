"""Do to a run what its case says; each leaves behind what must be undone before anything else."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from command_line import station_command
from guardian_helpers import World
from user_space_disk import UserSpaceDisk

from campaigns.standstill.runs import CTRL_C, CTRL_S, LOOKS_EVERY_S, MOVED, Attacked, memory_of

STRETCH_S = 1.0
"""From a terminal that stands still to a person's wish to end the run, at most."""
NEW_GUARDIAN_WITHIN_S = 15.0
SPARE_BYTES = 2 * 2**20
"""How much more than it has a process may have whose memory is limited, at most."""


@dataclass
class Scene:
    """A run, its bench and what the attack may draw."""

    run: Attacked
    bench: World
    disk: UserSpaceDisk | None
    rng: np.random.Generator
    energised: list[str]
    outage_s: float
    struck: list[int]
    """The processes of guardians that were struck."""
    asked: subprocess.Popen[str] | None = None
    """A person's `station abort`."""
    struck_s: float = 0.0
    """When that came from which the time is counted, Unix time."""
    guardian_struck_s: float = 0.0
    """When a guardian was struck, Unix time."""
    guarded_by: frozenset[int] = frozenset()
    """The guardians that there were then."""
    to_guardian_s: float | None = None
    """Real time from then until there was another; None before."""

    def signal(self, pid: int, number: signal.Signals) -> None:
        """Send a signal to a process."""
        os.kill(pid, number)

    def guardian(self) -> int:
        """Return one of the guardians, drawn where there are several."""
        found = self.run.guardians()
        assert found, "the run has no guardian"
        pid = found[int(self.rng.integers(len(found)))]
        self.guardian_struck_s, self.guarded_by = time.time(), frozenset(found)
        self.struck.append(pid)
        return pid

    def has_new_guardian(self) -> bool:
        """Whether there has been a guardian since that was not there when one was struck."""
        if self.to_guardian_s is None and set(self.run.guardians()) - self.guarded_by:
            self.to_guardian_s = round(time.time() - self.guardian_struck_s, 2)
        return self.to_guardian_s is not None


def strike(name: str, scene: Scene) -> None:
    """Do what an attack is; `struck_s` of the scene says when."""
    scene.struck_s = time.time()
    if name.startswith("outage-"):
        outage(name, scene)
    elif name.startswith("terminal-"):
        terminal(name, scene)
    else:
        ATTACKERS[name](scene)


def disk_frozen(scene: Scene) -> None:
    assert scene.disk is not None
    scene.disk.freeze()


def folder_removed(scene: Scene) -> None:
    while (folder := scene.run.folder) is not None:  # what is being written may be in the way
        shutil.rmtree(folder, ignore_errors=True)


def folder_moved(scene: Scene) -> None:
    folder = scene.run.folder
    assert folder is not None
    elsewhere = scene.run.parent.parent / MOVED
    elsewhere.mkdir()
    folder.rename(elsewhere / folder.name)


def folder_unmounted(scene: Scene) -> None:
    assert scene.disk is not None
    scene.disk.detach()


def runner_stopped(scene: Scene) -> None:
    scene.signal(scene.run.process.pid, signal.SIGSTOP)


def runner_killed(scene: Scene) -> None:
    scene.signal(scene.run.process.pid, signal.SIGKILL)


def guardian_killed(scene: Scene) -> None:
    scene.signal(scene.guardian(), signal.SIGKILL)


def guardian_stopped(scene: Scene) -> None:
    scene.signal(scene.guardian(), signal.SIGSTOP)


def guardian_killed_runner_later(scene: Scene) -> None:
    guardian_killed(scene)
    until_s = time.time() + NEW_GUARDIAN_WITHIN_S
    while time.time() < until_s and scene.run.alive and not scene.has_new_guardian():
        time.sleep(LOOKS_EVERY_S)
    if scene.run.alive:
        time.sleep(scene.rng.uniform(0.0, 2.0))
    scene.struck_s = time.time()
    with suppress(ProcessLookupError):  # the run was over: its exit code says so
        runner_killed(scene)


def guardian_stopped_runner_killed(scene: Scene) -> None:
    guardian_stopped(scene)
    time.sleep(scene.rng.uniform(0.0, 1.0))
    scene.struck_s = time.time()
    runner_killed(scene)


def both_killed(scene: Scene) -> None:
    pids = [scene.guardian(), scene.run.process.pid]
    for pid in scene.rng.permutation(pids):
        scene.signal(int(pid), signal.SIGKILL)


def memory_gone(scene: Scene) -> None:
    pid = scene.run.process.pid
    spare = int(scene.rng.uniform(0, SPARE_BYTES))
    subprocess.run(["prlimit", f"--pid={pid}", f"--as={memory_of(pid) + spare}:"], check=True)


def terminal(name: str, scene: Scene) -> None:
    """The terminal's output stands still, and perhaps a person wishes the run to end."""
    run, wish = scene.run, name.removeprefix("terminal-unread").removeprefix("-")
    assert run.master is not None
    if name == "terminal-ctrl-s":
        os.write(run.master, CTRL_S)
        return
    run.stop_reading()
    if wish == "":
        return
    time.sleep(scene.rng.uniform(0.0, STRETCH_S))
    scene.struck_s = time.time()
    if wish == "ctrl-c":
        os.write(run.master, CTRL_C)
    elif wish == "sigterm":
        scene.signal(run.process.pid, signal.SIGTERM)
    else:
        abort(scene)


def abort(scene: Scene) -> None:
    """Ask the run to end by `station abort`, from another terminal."""
    assert scene.run.folder is not None
    scene.asked = subprocess.Popen(
        station_command("abort", scene.run.folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        env=scene.run.environment,
    )


def outage(name: str, scene: Scene) -> None:
    """Nobody reaches an instrument for a while, and the run ends just then."""
    able: list[str] = scene.energised or sorted(scene.bench.report()["outputs"])
    instrument = able[int(scene.rng.integers(len(able)))]
    fault = "port-gone" if "port-gone" in name else "no-reply"
    lasts: dict[str, Any] = {"for": f"{scene.outage_s * scene.bench.speed:g} s"}
    scene.bench.inject(instrument=instrument, fault=fault, **lasts)
    ends = signal.SIGKILL if "killed" in name else signal.SIGINT
    scene.struck_s = time.time()
    scene.signal(scene.run.process.pid, ends)


ATTACKERS: dict[str, Callable[[Scene], None]] = {
    "disk-frozen": disk_frozen,
    "folder-removed": folder_removed,
    "folder-moved": folder_moved,
    "folder-unmounted": folder_unmounted,
    "runner-stopped": runner_stopped,
    "runner-killed": runner_killed,
    "guardian-killed": guardian_killed,
    "guardian-stopped": guardian_stopped,
    "guardian-killed-runner-later": guardian_killed_runner_later,
    "guardian-stopped-runner-killed": guardian_stopped_runner_killed,
    "both-killed": both_killed,
    "memory-gone": memory_gone,
}
