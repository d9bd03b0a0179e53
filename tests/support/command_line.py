"""The command line in a process of its own, and a short plan for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import IO

from for_people import need_sentences

PLAN = """\
plan: 1
procedure: rlg-magnetic-sensitivity
dut: {model: RLG-50, serial: SN-1}
parameters:
  frequency: 0.1 Hz
  amplitude: 1 mT
  sample_interval: 0.1 s
  duration: 100 s
  axes: [IA]
  pulse_weight: 0.0625 arcsec
  warm_up: {slope_limit: 10 deg/h^2, window: 1 min, at_most: 5 min}
limits:
  magnetic_sensitivity: {max_abs: 0.2 deg/h/mT}
"""


def station_command(*arguments: str | Path) -> list[str]:
    """Return the command line of a verb."""
    return [sys.executable, "-m", "station", *map(str, arguments)]


def sim_command(bench: str | Path, *options: str | float) -> list[str]:
    """Return the command line that serves a bench, and ends with the process that started it."""
    return station_command("sim", bench, *map(str, options), "--until-stdin-closes")


def station(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Do a verb in a folder; what it says is held to be sentences for a person."""
    done = subprocess.run(
        station_command(*arguments),
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **environment},
        timeout=120,
    )
    need_sentences(done.stdout + done.stderr, f"station {' '.join(arguments)}")
    return done


def begun(
    folder: Path | None, *arguments: str | Path, stdout: int | IO[str] = subprocess.PIPE
) -> subprocess.Popen[str]:
    """Begin a verb in a folder; its input and its messages are pipes."""
    return subprocess.Popen(
        station_command(*arguments),
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )


def with_addresses(bench: str, driver: str, address: str) -> str:
    """Return the text of a bench file with an address for each instrument of a driver.

    `{number}` in it counts them.
    """
    line = f"    driver: {driver}\n"
    first, *others = bench.split(line)
    parts = (
        f'{line}    address: "{address.format(number=number)}"\n{other}'
        for number, other in enumerate(others, start=1)
    )
    return first + "".join(parts)
