"""A small disk of its own, in a file, that a test can freeze, thaw and unmount; Linux and root."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SIZE_BYTES = 96 * 2**20
THAWS_WITHIN_S = 150.0
"""A process that writes to a frozen disk cannot be killed: whatever becomes of the test, another
process thaws the disk by then."""
TOOLS = ("mkfs.ext4", "mount", "umount", "fsfreeze", "losetup")
THAW = "sleep {seconds:g}; fsfreeze -u '{place}'"


def why_not() -> str | None:
    """Return why no such disk can be had here, None where it can."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return "a disk in a file can be mounted and frozen by root on Linux only"
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    return f"there is no {', '.join(missing)}" if missing else None


class LoopDisk:
    """A mounted disk in a file."""

    def __init__(self, image: Path, place: Path) -> None:
        self.image, self.place = image, place
        self._thawer: subprocess.Popen[bytes] | None = None
        self._attached = False

    def attach(self) -> None:
        """Mount the disk."""
        run("mount", "-o", "loop,noatime", self.image, self.place)
        self._attached = True

    def freeze(self) -> None:
        """From now on a write waits; the process that thaws is there before it does."""
        self._thawer = subprocess.Popen(
            ["sh", "-c", THAW.format(seconds=THAWS_WITHIN_S, place=self.place)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        run("fsfreeze", "-f", self.place)

    def thaw(self) -> None:
        """Let writes through again."""
        if self._thawer is None:
            return
        run("fsfreeze", "-u", self.place)
        self._thawer.kill()
        self._thawer.wait()
        self._thawer = None

    def detach(self) -> None:
        """Take the disk out of the tree of folders; files that are open stay open."""
        if self._attached:
            run("umount", "-l", self.place)
            self._attached = False


def run(*command: str | Path) -> None:
    """Do a command of the system's."""
    subprocess.run([str(part) for part in command], check=True, capture_output=True)


@contextmanager
def disk_or_skip(folder: Path) -> Iterator[LoopDisk]:
    """Yield a mounted disk for a test, or skip the test where none can be had."""
    import pytest

    if (why := why_not()) is not None:
        pytest.skip(why)
    with loop_disk(folder) as disk:
        yield disk


@contextmanager
def loop_disk(folder: Path) -> Iterator[LoopDisk]:
    """Yield a mounted disk, and take it away."""
    image, place = folder / "disk.img", folder / "disk"
    place.mkdir(parents=True, exist_ok=True)
    with image.open("wb") as file:
        file.truncate(SIZE_BYTES)
    run("mkfs.ext4", "-q", "-F", image)
    disk = LoopDisk(image, place)
    disk.attach()
    try:
        yield disk
    finally:
        try:
            disk.thaw()
        finally:
            disk.detach()
