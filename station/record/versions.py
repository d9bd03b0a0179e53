"""Which software a run or a report was made with."""

from __future__ import annotations

import platform
import socket
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from station import __version__

PACKAGES = (
    "numpy",
    "scipy",
    "GTC",
    "mcap",
    "pydantic",
    "pyvisa",
    "pyvisa-py",
    "python-can",
)


def versions() -> dict[str, Any]:
    """Return host, interpreter, package versions and, in a checkout, the git commit."""
    return {
        "host": socket.gethostname(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "station": __version__,
        "packages": {name: package_version(name) for name in PACKAGES},
        "git_commit": git_commit(),
    }


def package_version(name: str) -> str | None:
    """Return the installed version of a package, None where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def git_commit() -> str | None:
    """Return the commit of the checkout this code runs from, None outside one."""
    try:
        done = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
