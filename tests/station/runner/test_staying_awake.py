"""The operating system is asked not to sleep during a run, and that never fails one."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from station.runner.watchers import StayingAwake

if sys.platform != "linux":
    pytest.skip("systemd-inhibit; not verified elsewhere", allow_module_level=True)

INHIBITOR = """#!/bin/sh
echo "$@" > "{said}"
exec cat
"""
"""What `systemd-inhibit` is where its bus answers: it holds the lock while its command runs."""


@pytest.fixture
def said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A system of its own, by its search path; what was asked of it."""
    program = tmp_path / "systemd-inhibit"
    program.write_text(INHIBITOR.format(said=tmp_path / "said"), encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    return tmp_path / "said"


def test_the_request_lasts_until_the_run_ends(said: Path) -> None:
    awake = StayingAwake()
    began = time.monotonic()
    while not (said.is_file() and said.read_text(encoding="utf-8").endswith("\n")):
        assert time.monotonic() - began < 20.0
        time.sleep(0.01)
    assert "--what=sleep:idle" in said.read_text(encoding="utf-8")
    assert awake.refused() == ""
    awake.end()
    assert "ended with" in awake.refused()


def test_a_system_that_does_not_know_of_sleep_is_named_and_nothing_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    awake = StayingAwake()
    assert awake.refused() == "there is no systemd-inhibit"
    awake.end()
