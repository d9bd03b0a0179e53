"""Whole runs on a served bench that are made to stand still by the operating system."""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from campaign_helpers import only_run, short_plan
from command_line import station_command
from guardian_helpers import World, until

SPEED = 10.0
DRIVEN_A = 1.0
SLEW_AND_ZERO_S = 1.0 + 2.0
"""Half a period of the sine at 10 times real time, and what the machine does beside that."""


def long_plan(folder: Path) -> Path:
    """Write a plan that drives one coil for minutes, soon after it began."""
    warm_up = {"slope_limit": "1000 deg/h^2", "window": "20 s", "at_most": "5 min"}
    return short_plan(folder, axes=["IA"], frequency="0.2 Hz", duration="3000 s", warm_up=warm_up)


@contextmanager
def begun_run(
    bench: World, folder: Path, output: Path, *options: str, **popen: Any
) -> Iterator[subprocess.Popen[str]]:
    """Begin a run on a served bench, wait until its coil is driven, and kill what is left of it."""
    command = station_command(
        "run", long_plan(folder), "--served", bench.head, "--output", output, *options
    )
    known = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, text=True, encoding="utf-8", **{**known, **popen})
    try:
        until(lambda: is_driven(bench) or process.poll() is not None)
        assert process.poll() is None, process.stderr and process.stderr.read()
        yield process
    finally:
        process.kill()
        with suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=60)


def is_driven(bench: World) -> bool:
    """Whether the coil of the plan carries a current."""
    return abs(bench.report()["coils"]["x"]["current_A"]) > DRIVEN_A


def at_rest_after_s(bench: World, within_s: float) -> float:
    """Wait until the world is at rest, and return how long that took in real time."""
    began_s = time.monotonic()
    while not bench.at_rest():
        taken_s = time.monotonic() - began_s
        assert taken_s < within_s, f"driven after {taken_s:.1f} s: {bench.report()}"
        time.sleep(0.05)
    return time.monotonic() - began_s


def events_of(output: Path) -> list[dict[str, Any]]:
    """Return the events of the one run below a folder, and of its guardian."""
    folder = only_run(output)
    assert folder is not None
    logs = [folder / name for name in ("events.jsonl", "guardian.jsonl")]
    lines = [log.read_text(encoding="utf-8").splitlines() for log in logs if log.is_file()]
    return [json.loads(line) for one in lines for line in one]


@contextmanager
def stopped_terminal() -> Iterator[int]:
    """Yield a terminal whose output was stopped and whose buffer is full: nobody reads it."""
    master, slave = os.openpty()
    os.set_blocking(slave, False)
    with suppress(BlockingIOError):
        while True:
            os.write(slave, b"x" * 1024)
    os.set_blocking(slave, True)
    try:
        yield slave
    finally:
        os.close(slave)
        os.close(master)


PTRACE_DETACH, PTRACE_SEIZE, PTRACE_INTERRUPT = 17, 0x4206, 0x4207


@contextmanager
def stopped_thread(thread: int) -> Iterator[None]:
    """Stop one thread of another process, as a call that never returns does; raises OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
    for request in (PTRACE_SEIZE, PTRACE_INTERRUPT):
        if libc.ptrace(request, thread, None, None) < 0:
            raise OSError(ctypes.get_errno(), "ptrace")
    try:
        yield
    finally:
        libc.ptrace(PTRACE_DETACH, thread, None, None)
