"""A disk that can stand still: a file system in user space, served by a process beside the test.

While it is frozen, whoever writes to it waits in the kernel, and SIGKILL does not end that wait;
reads go on while fewer than ten wait. When its server ends, with the test at the latest, the
requests fail and nothing hangs. Linux with `/dev/fuse`.

python user_space_disk.py BACKING MOUNT serves the files of one folder at another until standard
input closes; the lines `freeze`, `thaw` and `held` on it are answered by a line each.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Condition, Thread
from typing import Any

REQUIRED = "STATION_FUSE_REQUIRED"
"""Set where a missing `/dev/fuse` is a failure."""


def why_not() -> str | None:
    """Return why no such disk can be had here, None where it can."""
    if sys.platform != "linux" or not os.access("/dev/fuse", os.R_OK | os.W_OK):
        return "there is no /dev/fuse that this user may use"
    return None if shutil.which("fusermount3") else "there is no fusermount3: install fuse3"


class NotMountedError(Exception):
    """No such disk can be had here."""


class UserSpaceDisk:
    """A mounted disk; its files lie in the folder `backing`."""

    def __init__(self, backing: Path, place: Path) -> None:
        self.backing, self.place = backing, place
        self._servers: list[subprocess.Popen[str]] = []

    def attach(self) -> None:
        """Mount the disk."""
        server = subprocess.Popen(
            [sys.executable, __file__, str(self.backing), str(self.place)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        self._servers.append(server)
        assert server.stdout is not None
        if server.stdout.readline() != "mounted\n":
            raise NotMountedError("a file system in user space cannot be mounted here")

    def freeze(self) -> None:
        """From now on a write waits."""
        self._ask("freeze")

    def thaw(self) -> None:
        """Let writes through again."""
        self._ask("thaw")

    def holds(self, thread: int) -> bool:
        """Whether a thread waits for a write to end."""
        return str(thread) in self._ask("held").split()

    def detach(self) -> None:
        """Take the disk out of the tree of folders; files that are open stay open."""
        unmount(self.place)

    def end(self) -> None:
        """Unmount it; whatever waits for it fails."""
        for server in self._servers:
            with suppress(BrokenPipeError):
                server.communicate()

    def _ask(self, line: str) -> str:
        server = self._servers[-1]
        assert server.stdin is not None and server.stdout is not None
        with suppress(BrokenPipeError):  # nothing is left of an unmounted disk once it is closed
            server.stdin.write(f"{line}\n")
            server.stdin.flush()
        return server.stdout.readline()


@contextmanager
def disk_or_skip(folder: Path) -> Iterator[UserSpaceDisk]:
    """Yield a mounted disk for a test, or skip the test where none can be had."""
    import pytest

    with ExitStack() as stack:
        try:
            if (why := why_not()) is not None:
                raise NotMountedError(why)
            disk = stack.enter_context(user_space_disk(folder))
        except NotMountedError as error:
            if REQUIRED in os.environ:
                raise
            pytest.skip(str(error))
        yield disk


@contextmanager
def user_space_disk(folder: Path) -> Iterator[UserSpaceDisk]:
    """Yield a mounted disk, and take it away."""
    disk = UserSpaceDisk(folder / "disk-files", folder / "disk")
    for made in (disk.backing, disk.place):
        made.mkdir(parents=True, exist_ok=True)
    try:
        disk.attach()
        yield disk
    finally:
        disk.end()


def unmount(place: Path | str) -> None:
    """Unmount a file system in user space, busy or not; one that is not mounted is left alone."""
    subprocess.run(["fusermount3", "-u", "-z", "-q", str(place)], check=False)


class Gate:
    """Where writers wait while the disk is frozen."""

    def __init__(self) -> None:
        self._changed = Condition()
        self._frozen = False
        self._waiting: list[int] = []

    def set_frozen(self, frozen: bool) -> None:
        with self._changed:
            self._frozen = frozen
            self._changed.notify_all()

    def threads_held(self) -> list[int]:
        with self._changed:
            return list(self._waiting)

    def pass_through(self, thread: int) -> None:
        with self._changed:
            self._waiting.append(thread)
            self._changed.wait_for(lambda: not self._frozen)
            self._waiting.remove(thread)


def serve(backing: str, place: str) -> None:
    """Serve the files below `backing` at `place` until standard input closes."""
    import mfusepy

    gate = Gate()

    def real(path: str) -> str:
        return backing + path

    def writing(act: Callable[..., Any]) -> Callable[..., Any]:
        def wait_and_act(*arguments: Any) -> Any:
            gate.pass_through(mfusepy.fuse_get_context()[2])
            return act(*arguments)

        return wait_and_act

    class Mirror(mfusepy.Operations):  # type: ignore[misc]
        """Passes every call on to the same file below `backing`."""

        use_ns = True

        def init(self, path: str) -> None:
            print("mounted", flush=True)

        def getattr(self, path: str, fh: int | None = None) -> dict[str, Any]:
            about = os.lstat(real(path)) if fh is None else os.fstat(fh)
            times = {f"st_{one}time": getattr(about, f"st_{one}time_ns") for one in "amc"}
            kept = ("st_mode", "st_nlink", "st_size", "st_uid", "st_gid", "st_ino", "st_blocks")
            return {**{key: getattr(about, key) for key in kept}, **times}

        def statfs(self, path: str) -> dict[str, int]:
            about = os.statvfs(real(path))
            return {key: getattr(about, key) for key in dir(about) if key.startswith("f_")}

        def readdir(self, path: str, fh: int) -> list[tuple[str, dict[str, int], int]]:
            with os.scandir(real(path)) as entries:
                names = [".", "..", *(entry.name for entry in entries)]
            about = [(name, os.lstat(Path(real(path), name))) for name in names]
            return [(name, {"st_mode": s.st_mode, "st_ino": s.st_ino}, 0) for name, s in about]

        def readlink(self, path: str) -> str:
            return str(Path(real(path)).readlink())

        def open(self, path: str, flags: int) -> int:
            return os.open(real(path), flags)

        def read(self, path: str, size: int, offset: int, fh: int) -> bytes:
            return os.pread(fh, size, offset)

        def release(self, path: str, fh: int) -> None:
            os.close(fh)

        @writing
        def create(self, path: str, mode: int, fi: None = None) -> int:
            return os.open(real(path), os.O_RDWR | os.O_CREAT, mode)

        @writing
        def write(self, path: str, data: bytes, offset: int, fh: int) -> int:
            return os.pwrite(fh, data, offset)

        @writing
        def truncate(self, path: str, length: int, fh: int | None = None) -> None:
            os.truncate(real(path) if fh is None else fh, length)

        @writing
        def fsync(self, path: str, datasync: int, fh: int) -> None:
            os.fsync(fh)

        @writing
        def fsyncdir(self, path: str, datasync: int, fh: int) -> None:
            """Folders are on the disk when they are made."""

        @writing
        def mknod(self, path: str, mode: int, dev: int) -> None:
            os.mknod(real(path), mode, dev)

        @writing
        def mkdir(self, path: str, mode: int) -> None:
            Path(real(path)).mkdir(mode=mode)

        @writing
        def rmdir(self, path: str) -> None:
            Path(real(path)).rmdir()

        @writing
        def unlink(self, path: str) -> None:
            Path(real(path)).unlink()

        @writing
        def rename(self, old: str, new: str) -> None:
            Path(real(old)).replace(real(new))

        @writing
        def link(self, target: str, source: str) -> None:
            os.link(real(source), real(target))

        @writing
        def symlink(self, target: str, source: str) -> None:
            Path(real(target)).symlink_to(source)

        @writing
        def chmod(self, path: str, mode: int) -> None:
            Path(real(path)).chmod(mode)

        @writing
        def chown(self, path: str, uid: int, gid: int) -> None:
            os.chown(real(path), uid, gid)

        @writing
        def utimens(self, path: str, times: tuple[int, int] | None = None) -> None:
            os.utime(real(path)) if times is None else os.utime(real(path), ns=times)

    def obey() -> None:
        for line in sys.stdin:
            if line.strip() != "held":
                gate.set_frozen(line.strip() == "freeze")
            print(*gate.threads_held(), flush=True)
        unmount(place)
        os._exit(0)

    Thread(target=obey, daemon=True).start()
    with suppress(RuntimeError):  # unmounted by somebody else
        mfusepy.FUSE(Mirror(), place, foreground=True, use_ino=True)


if __name__ == "__main__":
    serve(*sys.argv[1:])
