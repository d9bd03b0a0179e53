"""One run per instrument: a lock of the operating system on each instrument's address.

Every user of the computer finds the same locks, whatever bench file an address stands in.
"""

from __future__ import annotations

import hashlib
import tempfile
from contextlib import suppress
from pathlib import Path

from station.errors import InstrumentError
from station.locks import FileLock, LockHeld

FOLDER = "inertial-station-instruments"
EVERYBODY_FOLDER, EVERYBODY_FILE = 0o777, 0o666


def lock_place(address: str) -> Path:
    """Return the file whose lock stands for an instrument address; capitals make no difference."""
    digest = hashlib.sha256(address.strip().lower().encode()).hexdigest()[:24]
    return Path(tempfile.gettempdir()) / FOLDER / f"{digest}.lock"


class InstrumentLocks:
    """The instruments that this process has; instruments on one bus share its lock.

    `holder` is what another process is told of this one.
    """

    def __init__(self, holder: str) -> None:
        self._holder = holder
        self._held: dict[Path, FileLock] = {}

    def take(self, name: str, address: str) -> None:
        """Take an instrument, until `release` or until this process ends.

        Raises InstrumentError, before any byte is sent to it, where another process has it.
        """
        place = lock_place(address)
        if place in self._held:
            return
        try:
            if not place.parent.is_dir():
                place.parent.mkdir(parents=True, exist_ok=True)
                place.parent.chmod(EVERYBODY_FOLDER)
            self._held[place] = FileLock(place)
        except LockHeld as error:
            who = place.read_text(encoding="utf-8", errors="replace").strip()
            raise InstrumentError(
                name,
                f"take {address}",
                f"another process has it ({who})" if who else "another process has it",
                "wait until that has ended, or end it with `station abort`",
            ) from error
        except OSError as error:
            raise InstrumentError(
                name,
                f"take {address}",
                f"its lock {place} cannot be opened ({error.strerror or error})",
                "make that file writable for everybody who uses the bench",
            ) from error
        with suppress(OSError):  # it was made by another user, who did this
            place.chmod(EVERYBODY_FILE)
        place.write_text(f"{self._holder}\n", encoding="utf-8")

    def holds(self, address: str) -> bool:
        """Whether this process has what is at an address."""
        return lock_place(address) in self._held

    def release(self) -> None:
        """Give all of them back."""
        for lock in self._held.values():
            lock.release()
        self._held.clear()
