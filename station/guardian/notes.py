"""What a guardian says while it acts: by a lock, in its log and to the operator.

A disk or a terminal that hangs may be why the run died. It must not hold up the safe state: log and
operator have threads of their own, and nothing of the lock reads a disk that the run had.
"""

from __future__ import annotations

import json
import os
import signal
import stat
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

from station.clock import Clock, RealClock, utc_now
from station.errors import InputError, RecordError
from station.files.locks import FileLock, LockHeld, is_held
from station.guardian.watching import OtherProcess
from station.instruments.beside import started
from station.instruments.instrument_locks import lock_place
from station.record.events import EventLog
from station.record.files import write_whole_file
from station.record.layout import EVENTS, GUARDIAN_LOG, MANIFEST, file_hash

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


class GuardianLock:
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


LAST_WORDS_S = 30.0
"""How long the log may take once nothing else is left to do; nobody waits for it."""
SEALED_WITHIN_S = 1800.0
"""How long a run that has let go of its bench may take to evaluate what it measured."""
LOOKS_EVERY_S = 0.1


class Background:
    """Do one thing after the other, in order, in a thread that nobody waits for.

    Where the system gives no thread, what is due waits until it does.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._due: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread: Thread | None = None
        self._begin()

    def do(self, what: Callable[[], None]) -> None:
        """Do `what` when everything before it is done."""
        self._due.put(what)
        self._begin()

    def finish(self, within_s: float) -> None:
        """Wait until everything is done, or `within_s` of real time have passed."""
        self._due.put(None)
        self._begin()
        if self._thread is not None:
            self._thread.join(within_s)

    def _begin(self) -> None:
        if self._thread is None:
            self._thread = started(self._work, self._name)

    def _work(self) -> None:
        while (what := self._due.get()) is not None:
            what()


class OperatorOutput:
    """What is said to the operator on an open file, which may take nothing at all."""

    def __init__(self, file: int) -> None:
        self._file = file
        self._telling = Background("words")

    def tell(self, text: str) -> None:
        """Say something."""
        self._telling.do(lambda: self._write(f"guardian: {text}\n".encode()))

    def leave_pipes(self) -> None:
        """Let a program that reads what is said to its end go on; a terminal or a file stays."""
        self._telling.do(self._leave_pipes)

    def _leave_pipes(self) -> None:
        mode = os.fstat(self._file).st_mode
        if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
            os.dup2(os.open(os.devnull, os.O_WRONLY), self._file)

    def finish(self, within_s: float) -> None:
        """Wait until everything is said, or `within_s` of real time have passed."""
        self._telling.finish(within_s)

    def _write(self, left: bytes) -> None:
        with suppress(OSError):  # a broken pipe, a closed terminal: the log tells it all
            while left:
                left = left[os.write(self._file, left) :]


class Notes:
    """The guardian's log in the run folder, every event on disk.

    While `writer`, the run's process, still writes into the folder, nothing is.
    """

    def __init__(
        self, folder: Path, clock: Clock, words: OperatorOutput, writer: OtherProcess | None = None
    ) -> None:
        self._folder = folder
        self._clock = clock
        self._words = words
        self._log: EventLog | None = None
        self._within_s = SEALED_WITHIN_S if writer is not None else LAST_WORDS_S
        self._writing = Background("log")
        if writer is not None:
            self._writing.do(lambda: self._wait_for(writer))

    def note(self, kind: str, **details: Any) -> None:
        """Append an event of this moment, with its UTC."""
        time_s, utc = self._clock.now(), utc_now().isoformat(timespec="milliseconds")
        self._writing.do(lambda: self._append(time_s, kind, {"utc": utc, **details}))

    def close(self) -> None:
        """Wait until everything is written, within limits."""
        self._writing.do(self._cover)
        self._writing.finish(self._within_s)

    def _append(self, time_s: float, kind: str, details: dict[str, Any]) -> None:
        try:
            # What the run wrote by now is all that came before.
            events = (self._folder / EVENTS).read_bytes().count(b"\n")
            if self._log is None:
                self._log = EventLog(self._folder / GUARDIAN_LOG)
            details = {"after_events": events, **details}
            self._log.append(time_s, kind, details, durable=True)
        except (RecordError, OSError) as error:
            self._words.tell(f"not recorded: {error}")

    def _cover(self) -> None:
        """Let a manifest that the run left cover what came after it."""
        place = self._folder / MANIFEST
        try:
            if self._log is not None and place.is_file():
                data = json.loads(place.read_text(encoding="utf-8"))
                data["files"][GUARDIAN_LOG] = file_hash(self._folder / GUARDIAN_LOG)
                write_whole_file(place, f"{json.dumps(data, indent=1)}\n".encode())
        except (RecordError, OSError, ValueError, KeyError) as error:
            self._words.tell(f"not covered by the manifest: {error}")

    def _wait_for(self, writer: OtherProcess) -> None:
        clock = RealClock()
        until_s = clock.now() + SEALED_WITHIN_S
        while not writer.has_ended() and clock.now() < until_s:
            clock.sleep(LOOKS_EVERY_S)
