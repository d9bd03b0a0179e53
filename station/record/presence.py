"""Whether a run folder is still where it was made, the same one, and whose it is."""

from __future__ import annotations

from pathlib import Path

from station.errors import RecordError
from station.files.locks import FileLock
from station.record.manifest import LOCK


class Presence:
    """A folder as it was when this began; raises OSError where there is none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._identity = self._seen()

    def check(self) -> None:
        """Raise RecordError where another folder, or none, is at its place."""
        try:
            if self._seen() == self._identity:
                return
        except OSError:
            pass
        raise RecordError(
            f"the run folder {self._path} was removed, moved or unmounted while the run went on; "
            "what was recorded is in it, wherever it is now"
        )

    def cause_of(self, error: Exception) -> Exception:
        """Return why something failed: a file that cannot be read may be gone with its folder."""
        if isinstance(error, OSError):
            try:
                self.check()
            except RecordError as gone:
                return gone
        return error

    def _seen(self) -> tuple[int, int]:
        facts = self._path.stat()
        return facts.st_dev, facts.st_ino


def run_lock(folder: Path) -> FileLock:
    """Take the lock that says that a process is at work on a run; raises RecordError."""
    try:
        return FileLock(folder / LOCK)
    except OSError as error:
        raise RecordError(
            f"cannot lock {folder / LOCK}: {error.strerror or error}; choose another place, on a "
            "local disk, with --output"
        ) from error
