"""Run the conformance tests, in this process or as a laboratory does in one of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from places import ROOT

TESTS = ("-p", "station.conformance.plugin", "--pyargs", "station.conformance")
ALONE = ("-p", "no:cacheprovider", "-c", os.devnull)


@dataclass(eq=False)
class Outcome:
    """What became of the conformance tests; by name, those of one name and several cases as one."""

    exit_code: int = 0
    passed: set[str] = field(default_factory=set)
    failed: dict[str, str] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    """With what they say."""
    modules: set[str] = field(default_factory=set)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        module, _, name = report.nodeid.rpartition("::")
        name = name.partition("[")[0]
        self.modules.add(Path(module).stem)
        if report.failed:
            self.failed[name] = str(report.longrepr)
        elif report.skipped:
            self.skipped[name] = str(report.longrepr)
        elif report.when == "call":
            self.passed.add(name)


def conformance(driver: str, bench: str | Path = "sim", *more: str) -> Outcome:
    """Run the conformance tests of a driver in this process."""
    outcome = Outcome()
    quiet = (
        "-p",
        "no:terminal",
        "-p",
        "no:faulthandler",
        "-p",
        "no:xdist",
        "-p",
        "no:unraisableexception",
    )
    options = ("--station-driver", driver, "--station-bench", str(bench), *more)
    outcome.exit_code = int(pytest.main([*TESTS, *ALONE, *quiet, *options], plugins=[outcome]))
    return outcome


def conformance_of_its_own(
    folder: Path, driver: str, bench: str, *more: str
) -> subprocess.CompletedProcess[str]:
    """Run the conformance tests as a laboratory does, in a folder and a process of their own."""
    options = ("--station-driver", driver, "--station-bench", bench, *more)
    return subprocess.run(
        [sys.executable, "-m", "pytest", *TESTS, *ALONE, "-rf", "--no-header", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        timeout=120,
    )
