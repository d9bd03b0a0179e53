"""Finished runs that many tests read, each made once for all processes of a session."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from station.clock import RealClock
from station.files.locks import FileLock, LockHeld

LOOKS_EVERY_S = 0.1


def made_once(
    factory: pytest.TempPathFactory, name: str, make: Callable[[Path], Path | None]
) -> Path:
    """Return the run folder that `make` makes below the folder it is given; nobody may change it.

    The first process that asks makes it, the others wait. Whoever wants to change something takes
    a copy.
    """
    base = factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    shared.mkdir(exist_ok=True)
    lock = _waited_for(shared / f"{name}.lock")
    try:
        if not (shared / name).exists():
            making = shared / f"{name}.making"
            shutil.rmtree(making, ignore_errors=True)  # of a process that was ended
            making.mkdir()
            made = make(making)
            assert made is not None
            (making / "made").write_text(str(made.relative_to(making)), encoding="utf-8")
            making.rename(shared / name)
    finally:
        lock.release()
    return shared / name / (shared / name / "made").read_text(encoding="utf-8")


def _waited_for(path: Path) -> FileLock:
    while True:
        try:
            return FileLock(path)
        except LockHeld:
            RealClock().sleep(LOOKS_EVERY_S)
