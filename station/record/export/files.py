"""Files that appear whole: written beside their place, brought to disk, then moved there."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from station.errors import RecordError
from station.record.files import sync_data, sync_folder


class Sink(io.RawIOBase):
    """A file for a library that crashes when a write fails, as HDF5 does on a full disk.

    It takes everything; what it could not write is raised at its end, instead of whatever the
    library made of it.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w+b", buffering=0)
        self._error: OSError | None = None

    def __exit__(self, *_: object) -> None:
        self.close()
        if self._error is not None:
            raise self._error

    def readable(self) -> bool:
        """Return True."""
        return True

    def writable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a byte of the file."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the present byte of the file."""
        return self._file.tell()

    def readinto(self, buffer: Any) -> int:
        """Read into `buffer`; what a full disk did not take reads as zeros."""
        view = memoryview(buffer).cast("B")
        count = self._file.readinto(view) or 0
        if count < len(view) and self._error is not None:
            view[count:] = bytes(len(view) - count)
            return len(view)
        return count

    def write(self, data: Any) -> int:
        """Write all of `data`, or remember why it could not be."""
        left = memoryview(data).cast("B")
        length = len(left)
        try:
            while self._error is None and left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._error = error
        return length

    def truncate(self, size: int | None = None) -> int:
        """Give the file a length, or remember why it could not be."""
        try:
            return self._file.truncate(size)
        except OSError as error:
            self._error = self._error or error
            return size or 0

    def flush(self) -> None:
        """Do nothing: what was written is with the system already."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Give the name of a new file in the same folder; at the end it takes the place of `path`.

    Raises RecordError where it cannot be written; an older file of the name then stays.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with part.open("r+b") as file:
            sync_data(file.fileno())
        part.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise RecordError(
            f"cannot write {path}: {error.strerror or error}; make room on the disk, or export a "
            "copy of the run folder elsewhere"
        ) from error
    except BaseException:
        part.unlink(missing_ok=True)
        raise
