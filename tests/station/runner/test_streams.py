"""Standard streams that are full, closed or stopped: the exit code stays true, and nothing dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from campaign_helpers import only_run, short_plan
from command_line import station_command
from still_helpers import stopped_terminal

if sys.platform == "win32":
    pytest.skip("/dev/full and terminals of POSIX", allow_module_level=True)

VERBS = [("list", "plans", "--json"), ("schema", "plan"), ("validate", "serf-nonorthogonality")]


def closing(*handles: int) -> Callable[[], None]:
    """Return what closes standard streams before the command begins."""

    def close() -> None:
        for handle in handles:
            os.close(handle)

    return close


def command(*arguments: str | Path, **popen: Any) -> subprocess.CompletedProcess[str]:
    """Do a verb whose streams are what a test makes them."""
    return subprocess.run(
        station_command(*arguments), text=True, encoding="utf-8", check=False, timeout=120, **popen
    )


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_plan(tmp_path_factory.mktemp("plan"), axes=["IA"])


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
@pytest.mark.parametrize("how", ["full", "closed"])
def test_results_that_cannot_be_printed_are_a_fault_by_one_sentence(
    verb: tuple[str, ...], how: str
) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        streams = {"stdout": full} if how == "full" else {"preexec_fn": closing(1)}
        done = command(*verb, stderr=subprocess.PIPE, **streams)
    assert done.returncode == 3
    assert done.stderr.count("could not be written to standard output") == 1
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1 or verb[0] == "validate"


@pytest.mark.campaign
def test_a_pass_that_cannot_be_printed_is_no_fail(plan: Path, tmp_path: Path) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = command(
            *("run", plan, "--non-interactive", "--json", "--output", tmp_path),
            stdout=full,
            stderr=subprocess.PIPE,
        )
    assert done.returncode == 3
    assert "could not be written to standard output (No space left on device)" in done.stderr
    assert "the run folder has them" in done.stderr
    folder = only_run(tmp_path)
    assert folder is not None
    assert (folder / "results.json").is_file()
    assert (folder / "manifest.json").is_file()


def test_a_reader_that_leaves_early_loses_nothing_that_it_wanted() -> None:
    process = subprocess.Popen(
        station_command("schema", "plan"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 0
    assert process.stderr is not None
    assert not process.stderr.read()


@pytest.mark.campaign
@pytest.mark.parametrize("handles", [(2,), (0,), (0, 1, 2)])
def test_closed_streams_keep_no_run_from_its_end(
    plan: Path, tmp_path: Path, handles: tuple[int, ...]
) -> None:
    done = command("run", plan, "--output", tmp_path, preexec_fn=closing(*handles))
    assert done.returncode == (3 if 1 in handles else 0)
    folder = only_run(tmp_path)
    assert folder is not None
    log = (folder / "events.jsonl").read_text(encoding="utf-8")
    assert all(line.startswith("{") for line in log.splitlines()), "a message fell into the log"
    assert (folder / "manifest.json").is_file()


@pytest.mark.campaign
def test_a_terminal_that_is_stopped_holds_up_no_end(plan: Path, tmp_path: Path) -> None:
    with stopped_terminal() as terminal:
        done = command(
            *("run", plan, "--non-interactive", "--output", tmp_path),
            stdout=subprocess.PIPE,
            stderr=terminal,
        )
    assert done.returncode == 0
    assert "verdict: pass" in done.stdout


def test_a_terminal_that_goes_on_is_informed_of_what_is_missing() -> None:
    code = (
        "import sys, time\nfrom station.console import take_over_streams, tell\n"
        "take_over_streams()\n[tell(f'line {n} ' + 'x' * 200) for n in range(3000)]\n"
        "print('over', flush=True)\nsys.stdin.readline()\n[tell(f'last {n}') for n in range(3)]\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline() == "over\n", "3,000 lines that nobody reads hold up nobody"
    said: list[str] = []
    reader = Thread(target=lambda: said.extend(process.stderr or ()), daemon=True)
    reader.start()
    settled = -1
    while not said or settled != len(said):  # until all that was kept is read
        settled = len(said)
        time.sleep(0.5)
    process.stdin.write("\n")
    process.stdin.close()
    assert process.wait(60) == 0
    reader.join(60)
    (missing,) = [one for one in said if "lines are left out here" in one]
    kept = [one for one in said if one.startswith("line ")]
    assert int(missing.strip("(").split()[0]) + len(kept) == 3000
    assert [one.strip() for one in said[-3:]] == ["last 0", "last 1", "last 2"]


@pytest.mark.campaign
def test_results_that_nobody_reads_can_be_ended() -> None:
    with stopped_terminal() as terminal:
        process = subprocess.Popen(
            station_command("schema", "plan"), stdout=terminal, stderr=subprocess.PIPE, text=True
        )
        time.sleep(3.0)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20)
    assert process.returncode == 4
    assert "ended by the operator" in said
