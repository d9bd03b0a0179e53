"""A session of tests is one thing that ends as one: what is left of one that was ended."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_namespaces import folders_to_hide
from places import ROOT

if sys.platform != "linux":
    pytest.skip("namespaces of Linux", allow_module_level=True)

LOOK = ROOT / "tests" / "support" / "killed_session.py"
GUARDIANS = ROOT / "tests" / "station" / "guardian"
NOTHING: dict[str, list[str]] = {"processes": [], "stuck": [], "mounts": [], "files": []}
HOLDS = GUARDIANS / "test_guardian_holds.py"
STUCK = f"{HOLDS}::test_a_run_that_cannot_die_keeps_nobody_from_its_instruments"
ENVIRONMENT = {
    **{key: text for key, text in os.environ.items() if not key.startswith(("PYTEST_", "PYTHON"))},
    "PYTHONPATH": f"{ROOT}{os.pathsep}{LOOK.parent}",
    "PYTHONDONTWRITEBYTECODE": "1",
}
SEED = 37
MOMENTS_S = [f"{moment:.1f}" for moment in np.random.default_rng(SEED).uniform(4.0, 25.0, 3)[::2]]


def ended(how: str, after: str, *arguments: str) -> dict[str, Any]:
    """Start a session of tests, end it, and return what was seen then and afterwards."""
    done = subprocess.run(
        [sys.executable, str(LOOK), how, after, *arguments],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        env=ENVIRONMENT,
        timeout=200,
    )
    if done.returncode == 0 and not done.stdout:
        pytest.skip("no namespaces can be had here")
    assert done.returncode == 0, done.stderr
    seen: dict[str, Any] = json.loads(done.stdout)
    return seen


@pytest.mark.campaign
@pytest.mark.parametrize("after", MOMENTS_S)
@pytest.mark.parametrize("how", ["SIGKILL main", "SIGKILL group", "SIGKILL pytest"])
def test_nothing_is_left_of_a_session_that_is_killed(how: str, after: str) -> None:
    seen = ended(how, after, str(GUARDIANS), "-n", "2", "-m", "campaign or not campaign")
    assert not seen["ended_before"], seen
    assert seen["most"] > 6, "there were workers, simulators, runs or guardians"
    assert seen["left"] == NOTHING, seen


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("how", "code"),
    [("SIGTERM main", 143), ("SIGTERM group", 143), ("SIGINT main", 2), ("SIGINT group", 2)],
)
def test_a_time_limit_or_ctrl_c_ends_a_session(how: str, code: int) -> None:
    seen = ended(how, MOMENTS_S[0], str(GUARDIANS), "-n", "2", "-m", "campaign or not campaign")
    assert seen["code"] in (code, 130), seen  # what does not end by itself is ended
    assert seen["left"] == NOTHING, seen


@pytest.mark.campaign
@pytest.mark.parametrize("how", ["shared SIGKILL main", "shared SIGKILL group"])
def test_where_there_are_no_namespaces_another_process_ends_what_is_left(how: str) -> None:
    if shutil.which("setpriv") is None:
        pytest.skip("there is no setpriv")
    seen = ended(how, MOMENTS_S[0], str(GUARDIANS / "test_kill.py"), "-n", "2", "-m", "")
    assert seen["left"] == NOTHING, seen


@pytest.mark.campaign
def test_a_session_killed_while_its_disk_stands_still_leaves_nothing_that_hangs() -> None:
    seen = ended("SIGKILL group", "stuck", STUCK, "-m", "campaign or not campaign")
    assert seen["hung"], "a process hung in the kernel"
    assert seen["left"] == NOTHING, seen


def test_a_session_that_ends_by_itself_names_what_tests_left_and_leaves_nothing() -> None:
    seen = ended("none", "0", str(LOOK.with_name("untidy.py")))
    assert "1 passed" in seen["words"]
    assert "left by a test, ended now: sleep 1000" in seen["words"]
    assert seen["left"] == NOTHING, seen


def test_a_folder_with_something_that_is_needed_is_not_hidden() -> None:
    assert Path("/dev/shm") in folders_to_hide([])
    assert Path("/dev/shm") in folders_to_hide([Path("/dev/shm/clone")])
    assert Path("/dev/shm") not in folders_to_hide([Path("/dev/shm")])
