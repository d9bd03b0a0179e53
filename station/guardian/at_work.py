"""A guardian at work for a run that is gone: who it is, and what it waits for.

Nothing here reads a disk that the run had: that may be why the run is gone.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from station.errors import InputError
from station.files.locks import FileLock, LockHeld, is_held
from station.instruments.instrument_locks import lock_place

LEAVE = "SIGUSR1"
"""What ends a guardian that goes on trying, where the system has such a signal."""
OURS = b"station.guardian"


@dataclass(frozen=True)
class AtWork:
    """A guardian at work, and the instruments that it could not make safe so far."""

    pid: int
    waits_for: tuple[str, ...] = ()

    def sentence(self) -> str:
        """Return what it does, for a person."""
        if not self.waits_for:
            return f"the guardian of the run (process {self.pid}) is making the bench safe"
        names = ", ".join(self.waits_for)
        return f"the guardian of the run (process {self.pid}) goes on trying to make {names} safe"

    def leave(self) -> None:
        """Ask it to end after one more attempt; raises InputError where that cannot be done."""
        number = getattr(signal, LEAVE, None)
        if number is None or not is_guardian(self.pid):
            raise InputError(f"process {self.pid} cannot be asked to end here; end it by hand")
        try:
            os.kill(self.pid, number)
        except OSError as error:
            raise InputError(
                f"the guardian, process {self.pid}, is another user's ({error.strerror}); that "
                f"user ends it with `station abort` or `kill -USR1 {self.pid}`"
            ) from error


class WordOfWork:
    """The lock by which others find this guardian, for as long as it is at work."""

    def __init__(self, folder: str) -> None:
        self._place = place_of(folder)
        self._lock: FileLock | None = None

    def say(self, waits_for: Sequence[str] = ()) -> None:
        """Let others read that this process is at work, and what it waits for."""
        if self._lock is None:
            # Not to be had where the guardian before this one cannot die.
            with suppress(LockHeld, OSError):
                self._lock = FileLock(self._place)
        if self._lock is not None:
            data = {"pid": os.getpid(), "waits_for": list(waits_for)}
            self._lock.say(json.dumps(data))

    def end(self) -> None:
        """Be at work no more."""
        if self._lock is not None:
            self._lock.release()


def place_of(folder: str) -> Path:
    """Return the lock of the guardian of a run folder, given by its whole path."""
    return lock_place(f"guardian of {folder}")


def guardian_at_work(folder: Path) -> AtWork | None:
    """Return the guardian that is at work for the run of a folder, None where there is none."""
    place = place_of(str(folder.resolve()))
    with suppress(OSError, ValueError, TypeError, KeyError):
        if place.is_symlink() or not is_held(place):
            return None
        # Nobody but who has the run's folder is believed.
        if place.stat().st_uid in (folder.stat().st_uid, getattr(os, "geteuid", int)()):
            data = json.loads(place.read_text(encoding="utf-8"))
            return AtWork(int(data["pid"]), tuple(map(str, data["waits_for"])))
    return None


def is_guardian(pid: int) -> bool:
    """Whether a process is a guardian, as far as the system tells."""
    if sys.platform != "linux":
        return True
    try:
        return OURS in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
