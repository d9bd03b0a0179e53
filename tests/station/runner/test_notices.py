"""Somebody who is not at the bench is informed; a run neither waits for that nor fails by it."""

from __future__ import annotations

import sys
from pathlib import Path
from threading import Event

import pytest
from command_line import PLAN, station
from places import ROOT

from station.clock import boot_seconds
from station.runner import notices
from station.runner.notices import Notices

WITHIN_S = 60.0
WRITES = (
    "import os, sys; open(sys.argv[1], 'a').write(' '.join(os.environ['STATION_' + one] for one in "
    "('EVENT', 'SERIAL', 'BENCH', 'MESSAGE')) + chr(10))"
)


def until(path: Path, text: str) -> str:
    end_s = boot_seconds() + WITHIN_S
    while not (path.is_file() and text in (said := path.read_text(encoding="utf-8"))):
        assert boot_seconds() < end_s
        Event().wait(0.02)
    return said


@pytest.mark.campaign
def test_a_program_is_informed_at_the_end_of_a_run(tmp_path: Path) -> None:
    told = tmp_path / "told"
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    bench = tmp_path / "bench.yaml"
    command = [sys.executable, "-c", WRITES, str(told)]
    shipped = (ROOT / "config" / "benches" / "sim.yaml").read_text(encoding="utf-8")
    bench.write_text(f"{shipped}\nnotify: {{command: {command!r}}}\n", encoding="utf-8")
    options = ("--bench", "bench.yaml", "--non-interactive", "--output", "runs")
    done = station(tmp_path, "run", "plan.yaml", *options)
    assert done.returncode == 0, done.stderr
    assert until(told, "ended") == "ended SN-1 sim verdict pass; the bench is safe\n"


def test_a_prompt_is_passed_on_without_a_wait(tmp_path: Path) -> None:
    told = tmp_path / "told"
    command = (sys.executable, "-c", WRITES, str(told))
    Notices(command, tmp_path, "lab-1", "SN-9").prompt("Mount the gyro.")
    assert until(told, "Mount") == "prompt SN-9 lab-1 Mount the gyro.\n"


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("/no/such/program",), "no notification was sent: /no/such/program"),
        ((sys.executable, "-c", "raise SystemExit(3)"), "the program of `notify` ended with 3"),
        ((sys.executable, "-c", "import time; time.sleep(900)"), "ended with -9"),
    ],
)
def test_a_program_that_fails_is_a_warning(
    command: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard: list[str] = []
    monkeypatch.setattr(notices, "tell", heard.append)
    monkeypatch.setattr(notices, "ENDS_WITHIN_S", 1.0)
    Notices(command, tmp_path, "lab-1", "SN-9").prompt("Mount the gyro.")
    end_s = boot_seconds() + WITHIN_S
    while not heard and boot_seconds() < end_s:
        Event().wait(0.02)
    assert said in heard[0]


def test_without_a_program_nothing_is_started(tmp_path: Path) -> None:
    assert Notices((), tmp_path, "lab-1", "SN-9")._start("prompt", "Mount it.") is None
