"""Ends what a session of tests leaves where it cannot have namespaces of its own.

A process beside the session waits until pytest is gone, however it went, and ends every process
that carries the session's mark in its environment; what it finds no longer, the next session does.

python leftovers.py FOLDER waits for the end of standard input, then ends the session of a folder.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
from user_space_disk import unmount

from station.errors import StationError
from station.files.locks import is_held
from station.instruments.instrument_locks import PREFIX, lock_folder

SESSION = "STATION_TESTS_SESSION"
"""In the environment of whatever a session starts: its folder, in which all its files lie."""
FOLDERS = "station-tests-"
NAME = re.compile(rf"{FOLDERS}(\d+)-(\d+)-(\d+)-\w+")
"""The namespace of processes, the process in it that made the folder, and when, in Unix time."""
ENDS_WITHIN_S = 8.0


def begin_session() -> None:
    """End what earlier sessions left, and have another process end this one with this process."""
    for earlier in Path(tempfile.gettempdir()).glob(f"{FOLDERS}*"):
        if NAME.fullmatch(earlier.name) and is_own(earlier) and not is_owner_alive(earlier):
            end_session(earlier)
    owner = f"{namespace_number()}-{os.getpid()}-{time.time():.0f}"
    folder = tempfile.mkdtemp(prefix=f"{FOLDERS}{owner}-")
    global cleaner  # its input closes with this process, not before
    cleaner = subprocess.Popen(
        [sys.executable, __file__, folder],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    os.environ.update({SESSION: folder, "TMPDIR": folder, "PYTEST_DEBUG_TEMPROOT": folder})
    tempfile.tempdir = None  # so that it is looked up again


cleaner: subprocess.Popen[bytes] | None = None
"""The process that ends this session."""


def namespace_number() -> int:
    """Return what distinguishes the processes of this system from another's; 0 if nothing."""
    with suppress(OSError):
        return Path("/proc/self/ns/pid").stat().st_ino
    return 0


def is_own(path: Path) -> bool:
    """Whether this user made a file or folder, which is no link."""
    with suppress(OSError):
        about = path.lstat()
        return not stat.S_ISLNK(about.st_mode) and about.st_uid == getattr(os, "getuid", int)()
    return False


def is_owner_alive(folder: Path) -> bool:
    """Whether the process that made the folder of a session lives, or may, out of our sight."""
    namespace, owner, began_s = owner_of(folder)
    if namespace != namespace_number():
        return True
    with suppress(psutil.Error):
        return float(psutil.Process(owner).create_time()) <= began_s + 1.0
    return False


def owner_of(folder: Path) -> tuple[int, int, float]:
    """Return namespace and number of the process that made a session's folder, and Unix time."""
    named = NAME.fullmatch(folder.name)
    assert named
    return int(named[1]), int(named[2]), float(named[3])


def end_session(folder: Path) -> None:
    """End the processes of a session, and remove its mounts, its files and its locks."""
    ends_by_s = time.monotonic() + ENDS_WITHIN_S
    while (left := list(processes_of(folder))) and time.monotonic() < ends_by_s:
        for process in left:
            with suppress(psutil.Error):
                process.kill()
        psutil.wait_procs(left, timeout=0.2)
    for mount in psutil.disk_partitions(all=True):
        if Path(mount.mountpoint).is_relative_to(folder):
            unmount(mount.mountpoint)
    _, _, began_s = owner_of(folder)
    for lock in lock_folder().glob(f"{PREFIX}-*.lock"):
        with suppress(OSError, StationError):
            if is_own(lock) and lock.stat().st_ctime >= began_s - 1.0 and not is_held(lock):
                lock.unlink()
    shutil.rmtree(folder, ignore_errors=True)


def processes_of(folder: Path) -> Iterator[psutil.Process]:
    """Yield every process that a session has started and that lives."""
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.environ().get(SESSION) == str(folder):
                yield process


if __name__ == "__main__":
    sys.stdin.read()
    end_session(Path(sys.argv[1]))
