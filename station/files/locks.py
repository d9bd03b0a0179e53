"""Locks of the operating system: they end with their processes and are never stale.

A lock belongs to an opening of its file, not to a process: whoever is handed that opening holds it,
too, and it is free when the last of them has closed it.
"""

from __future__ import annotations

import errno
import os
import socket
import stat
import sys
from contextlib import suppress
from pathlib import Path

from station.clock import RealClock
from station.errors import InputError, NotPermitted, StationError

TRIES = 20
BETWEEN_TRIES_S = 0.01
"""Whoever asks whether a lock is held has it for a moment: one refusal says nothing yet."""
OWN_FILE, EVERYBODY_FILE = 0o644, 0o666
# No link is followed: its maker would choose which file is written to.
FLAGS = 0
for _flag in ("O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK", "O_BINARY"):
    FLAGS |= getattr(os, _flag, 0)

REFUSED = (BlockingIOError, PermissionError)
"""What the system raises, here and on Windows, when another opening of the file has the lock."""


class LockHeld(StationError):
    """Another process holds the lock."""


if sys.platform == "win32":
    import msvcrt

    FAR_BYTE = 0x7FFF0000
    """Windows keeps others from reading what is locked, so a byte beyond the file's end is."""

    def _take(file: int) -> None:
        os.lseek(file, FAR_BYTE, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _take(file: int) -> None:
        # flock belongs to this opening of the file; a lock by lockf would end as soon as anything
        # in this process closed the same file.
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


class FileLock:
    """A lock that is held until `release`, or until every process that has it has ended.

    One for `everybody` may be taken by every user of the computer and, on Linux, has a name beside
    its file, which nobody can remove. Its file goes with the last who holds it.
    """

    def __init__(self, path: Path, *, everybody: bool = False) -> None:
        """Take the lock, creating its file.

        Raises LockHeld where another process has it, OSError where the file system has no locks
        or the file is a link.
        """
        self.path = path
        self._everybody = everybody
        clock = RealClock()
        for _ in range(TRIES):
            try:
                self.files = self._try()
                return
            except REFUSED as error:
                if isinstance(error, PermissionError) and sys.platform != "win32":
                    raise
                clock.sleep(BETWEEN_TRIES_S)
        raise LockHeld(f"{self.path.parent} is in use by another process")

    @classmethod
    def handed_on(cls, path: Path, files: list[int]) -> FileLock:
        """Hold a lock, too, whose opened `files` another process has handed on."""
        lock = cls.__new__(cls)
        lock.path, lock.files, lock._everybody = path, files, True
        return lock

    def say(self, text: str) -> None:
        """Let whoever is refused read who holds the lock; another user's file stays as it is."""
        with suppress(OSError):
            os.ftruncate(self.files[0], 0)
            os.lseek(self.files[0], 0, os.SEEK_SET)
            os.write(self.files[0], text.encode())

    def release(self) -> None:
        """Give the lock back.

        The file of one run stays. One for everybody is removed, where nobody else holds it.
        """
        while self.files:
            with suppress(OSError):
                os.close(self.files.pop())
        if self._everybody:
            remove_if_free(self.path)

    def _try(self) -> list[int]:
        file = _open(self.path, EVERYBODY_FILE if self._everybody else OWN_FILE)
        try:
            _take(file)
            if not _is_at(file, self.path):  # removed, or replaced, since it was opened
                raise BlockingIOError
            if self._everybody and sys.platform == "linux":
                return [file, _named(self.path.name)]
        except BaseException:
            os.close(file)
            raise
        return [file]


def remove_if_free(path: Path) -> None:
    """Remove the file of a lock that nobody holds; what is not this user's own file stays.

    It is removed while it is locked: whoever opened it before finds that it is not the one at its
    path any more, and makes another. Windows removes no file that is open; it stays there.
    """
    if sys.platform == "win32":
        return
    with suppress(OSError):
        file = os.open(path, FLAGS | os.O_RDONLY)
        try:
            about = os.fstat(file)
            own = about.st_uid == os.geteuid() and about.st_nlink == 1
            if own and stat.S_ISREG(about.st_mode):
                _take(file)
                if _is_at(file, path):
                    path.unlink()
        finally:
            os.close(file)


def is_held(path: Path) -> bool:
    """Whether a process holds the lock on a file, this one included; the file may be missing.

    Where the lock is free it is taken and given back at once.
    """
    if not path.is_file():
        return False
    try:
        # For reading: on a disk that takes no writes for a while nothing opens for more than that.
        return _is_taken(path, os.O_RDONLY)
    except OSError as error:  # a network disk may want more
        if error.errno == errno.ELOOP:
            raise InputError(
                f"{path} is a link: no run makes one; look who put it there"
            ) from error
        if not os.access(path, os.W_OK):
            if isinstance(error, PermissionError):
                raise NotPermitted(path) from error
            raise
        return _is_taken(path, os.O_RDWR)


def _is_taken(path: Path, mode: int) -> bool:
    file = os.open(path, FLAGS | mode)
    try:
        _take(file)
    except REFUSED:
        return True
    finally:
        os.close(file)
    return False


def _open(path: Path, mode: int) -> int:
    """Open a plain file of one name, or make it; raises OSError for anything else."""
    try:
        # Made by nobody but us, or there: some systems refuse to make what another user has made.
        file = os.open(path, FLAGS | os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
        if mode == EVERYBODY_FILE and sys.platform != "win32":  # whatever the umask took away
            os.fchmod(file, mode)
    except FileExistsError:
        try:
            file = os.open(path, FLAGS | os.O_RDWR)
        except PermissionError:  # another user's, and enough for a lock
            file = os.open(path, FLAGS | os.O_RDONLY)
        except FileNotFoundError as error:
            raise BlockingIOError from error
    about = os.fstat(file)
    if not stat.S_ISREG(about.st_mode) or about.st_nlink > 1:
        os.close(file)
        raise OSError(errno.ELOOP, "it is not a plain file of one name", str(path))
    return file


def _is_at(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), os.lstat(path))
    except FileNotFoundError:
        return False


def _named(name: str) -> int:
    """Return a socket that has a name of its own, on no disk, for as long as it is open."""
    named = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        named.bind(f"\0inertial-station/{name}")
    except OSError as error:
        named.close()
        if error.errno == errno.EADDRINUSE:
            raise BlockingIOError from error
        raise
    return named.detach()
