"""Writing so that a kill, a lost power supply or a full disk leaves no half of anything."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from station.errors import RecordError

ANOTHER_DISK = "choose another one with --output"
A_COPY = "take a copy of the run folder elsewhere"
READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)


class AppendOnlyFile:
    """A file that grows by whole pieces: one that does not fit is taken back.

    What was appended is with the operating system when `append` returns: it survives the death of
    the process. `sync` waits until the disk has it.
    """

    def __init__(self, path: Path, *, new: bool) -> None:
        self.path = path
        try:
            self._file = path.open("xb" if new else "ab", buffering=0)
        except OSError as error:
            raise not_written(path, error) from error
        self._whole = path.stat().st_size

    @property
    def size(self) -> int:
        """How many bytes of the file are whole."""
        return self._whole

    def append(self, piece: bytes) -> None:
        """Write all of `piece`, or nothing and raise RecordError."""
        left = memoryview(piece)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._take_back()
            raise not_written(self.path, error) from error
        self._whole += len(piece)

    def sync(self) -> None:
        """Wait until the disk has all that was appended; raises RecordError."""
        try:
            sync_data(self._file.fileno())
        except OSError as error:
            raise not_written(self.path, error) from error

    def close(self) -> None:
        """Close the file; raises RecordError where the system only now says that it is not kept."""
        try:
            self._file.close()
        except OSError as error:
            raise not_written(self.path, error) from error

    def _take_back(self) -> None:
        with suppress(OSError):  # a reader leaves out a last piece that is not whole
            self._file.truncate(self._whole)
            self._file.seek(self._whole)


def write_whole_file(path: Path, data: bytes, otherwise: str = ANOTHER_DISK) -> None:
    """Write a file that is there whole or not at all, on disk when this returns.

    Raises RecordError; an older file of the name then stays as it was.
    """
    with replaced(path, otherwise) as part:
        part.write_bytes(data)


@contextmanager
def replaced(path: Path, otherwise: str = ANOTHER_DISK, *, parents: bool = False) -> Iterator[Path]:
    """Give the name of a new file in the same folder; at the end it takes the place of `path`.

    Raises RecordError where it cannot be written; an older file of the name then stays.
    """
    part = part_of(path)
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with part.open("r+b") as file:
            sync_data(file.fileno())
        part.replace(path)
        sync_folder(path.parent)
    except BaseException as error:
        with suppress(OSError):  # a disk that takes no writes takes no removal either
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise not_written(path, error, otherwise) from error
        raise


def part_of(path: Path) -> Path:
    """Return where a file is written before it takes its place; a kill may leave it there."""
    return path.with_name(f".{path.name}.part")


def sync_data(descriptor: int) -> None:
    """Wait until the disk has a file's data and its length."""
    # Windows has no fdatasync.
    os.fdatasync(descriptor) if hasattr(os, "fdatasync") else os.fsync(descriptor)


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder: without it a new file may lose its name."""
    if os.name != "posix":
        return  # Windows can neither open nor sync a folder
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def not_written(path: Path, error: OSError, otherwise: str = ANOTHER_DISK) -> RecordError:
    """Return the error of a file that could not be written, for the operator."""
    why = f"cannot write {path}: {error.strerror or error}"
    mend = "make its folder writable" if error.errno in READ_ONLY else "make room on the disk"
    return RecordError(f"{why}; {mend}, or {otherwise}")


def json_text(data: Mapping[str, Any]) -> str:
    """Return data as the text of a JSON file; numbers must be finite."""
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def is_own_file(path: Path) -> bool:
    """Whether a path is a plain file: no link to elsewhere, no pipe that would be waited for."""
    try:
        return path.is_file() and not path.is_symlink()
    except (OSError, ValueError):  # a name that no file system takes
        return False
