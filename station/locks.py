"""Locks of the operating system on a file: they end with their process and are never stale."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import IO

from station.clock import RealClock
from station.errors import StationError

TRIES = 20
BETWEEN_TRIES_S = 0.01
"""Whoever asks whether a lock is held has it for a moment: one refusal says nothing yet."""


REFUSED = (BlockingIOError, PermissionError)
"""What the system raises, here and on Windows, when another opening of the file has the lock."""


class LockHeld(StationError):
    """Another process holds the lock."""


if sys.platform == "win32":
    import msvcrt

    FAR_BYTE = 0x7FFF0000
    """Windows keeps others from reading what is locked, so a byte beyond the file's end is."""

    def _take(file: IO[bytes]) -> None:
        file.seek(FAR_BYTE)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _take(file: IO[bytes]) -> None:
        # flock belongs to this opening of the file; a lock by lockf would end as soon as anything
        # in this process closed the same file.
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


class FileLock:
    """A lock that this process holds until `release`, or until it ends in whatever way."""

    def __init__(self, path: Path) -> None:
        """Take the lock, creating its file.

        Raises LockHeld where another process has it, OSError where the file system has no locks.
        """
        self.path = path
        self._file = path.open("ab")
        try:
            self._take()
        except BaseException:
            self._file.close()
            raise

    def release(self) -> None:
        """Give the lock back; the file stays, since another process may be about to open it."""
        self._file.close()

    def _take(self) -> None:
        clock = RealClock()
        for _ in range(TRIES):
            try:
                return _take(self._file)
            except REFUSED:
                clock.sleep(BETWEEN_TRIES_S)
        raise LockHeld(f"{self.path.parent} is in use by another process")


def is_held(path: Path) -> bool:
    """Whether a process holds the lock on a file, this one included; the file may be missing.

    Where the lock is free it is taken and given back at once.
    """
    if not path.is_file():
        return False
    try:
        # For reading: on a disk that takes no writes for a while nothing opens for more than that.
        return _is_taken(path, "rb")
    except OSError:  # a network disk may want more
        if not os.access(path, os.W_OK):
            raise
        return _is_taken(path, "r+b")


def _is_taken(path: Path, mode: str) -> bool:
    with path.open(mode) as file:
        try:
            _take(file)
        except REFUSED:
            return True
    return False
