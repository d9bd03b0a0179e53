"""A disk that the operating system freezes: whoever writes to it is stuck until it is thawed."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

THAWS_AFTER_S = 90
"""By a process of its own, whatever becomes of the test."""


@dataclass
class FrozenDisk:
    """A file system of its own."""

    folder: Path

    def freeze(self) -> None:
        """Let every write wait."""
        late = f"sleep {THAWS_AFTER_S}; fsfreeze -u '{self.folder}' 2>/dev/null"
        subprocess.Popen(["sh", "-c", late], start_new_session=True)
        subprocess.run(["fsfreeze", "-f", str(self.folder)], check=True)

    def thaw(self) -> None:
        """Let writes go on."""
        subprocess.run(["fsfreeze", "-u", str(self.folder)], check=False, capture_output=True)


@contextmanager
def frozen_disk(parent: Path, size_mb: int = 32) -> Iterator[FrozenDisk]:
    """Mount a disk below `parent`; skip the test where this user may not."""
    if os.geteuid() != 0:
        pytest.skip("mounting a disk needs root")
    image, folder = parent / "disk.img", parent / "disk"
    folder.mkdir()
    with image.open("wb") as file:
        file.truncate(size_mb << 20)
    made = subprocess.run(["mkfs.ext4", "-q", str(image)], check=False, capture_output=True)
    mounted = (
        made.returncode == 0
        and not subprocess.run(
            ["mount", "-o", "loop", str(image), str(folder)], check=False, capture_output=True
        ).returncode
    )
    if not mounted:
        pytest.skip("no disk can be mounted here")
    disk = FrozenDisk(folder)
    try:
        yield disk
    finally:
        disk.thaw()
        subprocess.run(["umount", "-l", str(folder)], check=False, capture_output=True)
