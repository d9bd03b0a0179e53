"""`station pause`, `resume`, `abort` and `status` on whole runs in processes of their own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from campaign_helpers import finished_units, only_run, short_plan, station
from campaign_helpers import whole_events as events_of
from command_line import begun
from guardian_helpers import until, world

from station.control.channel import ask

SPEED = 25.0
SHORT = {"frequency": "0.2 Hz", "duration": "50 s"}


@contextmanager
def running(*arguments: str | Path, parent: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Start a run; yield its process and its folder."""
    process = begun(None, "run", *arguments, "--non-interactive", "--output", parent)
    try:
        until(lambda: parent.is_dir() and only_run(parent))
        folder = only_run(parent)
        assert folder is not None
        yield process, folder
    finally:
        process.kill()
        process.communicate()


def kinds(run: Path) -> list[str]:
    return [event["event"] for event in events_of(run)]


def state(run: Path) -> str:
    return str(json.loads(station("status", run, "--json").stdout)["state"])


@pytest.mark.campaign
def test_a_served_run_is_paused_goes_on_and_is_aborted_in_the_middle_of_a_unit(
    tmp_path: Path,
) -> None:
    # Six seconds of real time a unit, so that a busy computer, too, aborts in its middle.
    plan = short_plan(tmp_path, axes=["IA", "NA"], **{**SHORT, "duration": "150 s"})
    with (
        world(tmp_path, SPEED) as bench,
        running(plan, "--served", bench.head, parent=tmp_path / "runs") as (process, run),
    ):
        paused = station("pause", run)
        assert paused.returncode == 0, paused.stderr
        assert "coil_supply.x       output off" in paused.stdout
        assert "the run pauses before its next unit of work" in paused.stderr
        assert bench.at_rest()
        assert state(run) == "paused"
        assert finished_units(run) == ["warm-up"]
        assert station("resume", run).returncode == 0
        until(lambda: "unit-started" in kinds(run))
        assert state(run) == "running"
        assert not bench.at_rest()
        aborted = station("abort", run)
        assert aborted.returncode == 0, aborted.stderr
        assert "the run was ended by `station abort`" in aborted.stdout
        assert "the bench is safe, read back from every instrument" in aborted.stdout
        assert bench.at_rest()
        _, said = process.communicate(timeout=60)
    assert process.returncode == 4, said
    assert kinds(run)[-3:] == ["failed", "safe-state", "run-ended"]
    assert finished_units(run) == ["warm-up"]
    again = station("abort", run, "--json")
    assert again.returncode == 2
    assert "the run is not running" in json.loads(again.stdout)["error"]


@pytest.mark.campaign
def test_a_pause_changes_no_result(tmp_path: Path) -> None:
    warm_up = {"slope_limit": "10 deg/h^2", "window": "10 min", "at_most": "20 min"}
    plan = short_plan(tmp_path, axes=["IA"], warm_up=warm_up, **SHORT)
    done = station("run", plan, "--non-interactive", "--output", tmp_path / "undisturbed")
    assert done.returncode in (0, 6), done.stderr  # a short record may decide nothing
    undisturbed = only_run(tmp_path / "undisturbed")
    assert undisturbed is not None
    with running(plan, parent=tmp_path / "runs") as (process, run):
        # At once: a run on virtual time is over in a second or two.
        assert ask(run, "pause", 60.0)["outcome"] == "paused"
        assert state(run) == "paused"
        assert station("resume", run).returncode == 0
        _, said = process.communicate(timeout=60)
    assert process.returncode in (0, 6), said
    (one,), (other,) = results(run), results(undisturbed)
    assert abs(one["value"] - other["value"]) < one["standard_uncertainty"]
    pauses = {"pause-requested", "paused", "went-on"}
    assert [kind for kind in kinds(run) if kind not in pauses] == kinds(undisturbed)
    asked = station("pause", run)
    assert asked.returncode == 2
    assert "it is finished" in asked.stderr


def results(run: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((run / "results.json").read_text("utf-8"))["results"]
    return found


if sys.platform == "win32":
    pytest.skip("runs are killed here in the way of POSIX", allow_module_level=True)
