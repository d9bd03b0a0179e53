"""Run the conformance tests as a laboratory does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from places import ROOT


def conformance(
    folder: Path, driver: str, bench: str = "sim", *more: str
) -> subprocess.CompletedProcess[str]:
    """Run the conformance tests as a laboratory does, in a folder of its own."""
    command = [sys.executable, "-m", "pytest", "-p", "station.conformance.plugin"]
    command += ["--pyargs", "station.conformance", "-p", "no:cacheprovider", "-rf", "--no-header"]
    command += ["-c", os.devnull, "--station-driver", driver, "--station-bench", bench, *more]
    root = str(ROOT)
    return subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), root])},
        timeout=120,
    )
