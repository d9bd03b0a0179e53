"""Files that appear whole: written beside their place, brought to disk, then moved there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.errors import RecordError
from station.record.files import sync_data, sync_folder


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
