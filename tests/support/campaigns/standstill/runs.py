"""A run of the station in a process of its own that is attacked, and all that can be seen of it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import termios
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Any

from campaign_helpers import only_run
from command_line import station_command
from guardian_helpers import World, until
from short_forms import SHORT_FORMS

from campaigns.standstill.cases import SHORTER

MARK = "STANDSTILL_CASE"
"""Every process that a run starts has this in its environment, and is found by it."""
GUARDIAN = b"station.guardian"
CTRL_C, CTRL_S, CTRL_Q = b"\x03", b"\x13", b"\x11"
MOVED = "moved"
"""The name of the folder to which a run folder is moved."""
LOOKS_EVERY_S = 0.05
DEAD = "ZX"


@dataclass
class Attacked:
    """A run's process, the files that hold its words, and the mark of what it starts."""

    process: subprocess.Popen[bytes]
    parent: Path
    words: Path
    mark: str
    environment: dict[str, str]
    """What others stand in who ask for the same run, such as a person with another terminal."""
    master: int | None = None
    """The other side of its terminal."""
    terminal: str = ""
    """The name of its terminal."""
    said: list[tuple[float, str]] = field(default_factory=list)
    """What was written, and the Unix time at which that was seen."""
    _drained: Event = field(default_factory=Event)
    _read: int = 0

    @property
    def folder(self) -> Path | None:
        """The run folder, None before there is one; also where it was moved to."""
        for parent in (self.parent, self.parent.parent / MOVED):
            if parent.is_dir() and (found := only_run(parent)) is not None:
                return found
        return None

    @property
    def alive(self) -> bool:
        """Whether the run's process goes on."""
        return self.process.poll() is None

    def others(self) -> list[int]:
        """Return every process that the run has started and that lives, the oldest first."""
        wanted = f"{MARK}={self.mark}".encode()
        found = [pid for pid in processes() if wanted in environment_of(pid)]
        return sorted((pid for pid in found if pid != self.process.pid), key=start_of)

    def guardians(self) -> list[int]:
        """Return the guardians that live, the oldest first."""
        return [pid for pid in self.others() if GUARDIAN in command_of(pid)]

    def events(self) -> list[dict[str, Any]]:
        """Return the whole lines of the run's log and of its guardian's, in that order."""
        folder, found = self.folder, []
        for name in ("events.jsonl", "guardian.jsonl"):
            if folder is not None and (folder / name).is_file():
                lines = (folder / name).read_bytes().split(b"\n")[:-1]
                found += [{**json.loads(line), "log": name} for line in lines if line]
        return found

    def new_words(self) -> str:
        """Return what was written since the last look."""
        with self.words.open("rb") as file:
            file.seek(self._read)
            new = file.read()
        self._read += len(new)
        text = new.decode("utf-8", "replace")
        if text:
            self.said.append((time.time(), text))
        return text

    def all_words(self) -> str:
        """Return all that was written."""
        self.new_words()
        return "".join(text for _, text in self.said)

    def stop_reading(self) -> None:
        """Leave the terminal unread, and fill it: from now on whoever writes there waits."""
        assert self.master is not None
        self._drained.set()
        own = os.open(self.terminal, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        with suppress(BlockingIOError):
            while True:
                os.write(own, b"\r\n")
        os.close(own)

    def read_on(self) -> None:
        """Read the terminal again, and let its output go on."""
        if self.master is not None:
            with suppress(OSError):
                os.write(self.master, CTRL_Q)
        if self.master is not None and self._drained.is_set():
            self._drained = Event()
            self._start_reading()

    def _start_reading(self) -> None:
        Thread(target=self._drain, args=(self._drained,), daemon=True).start()

    def _drain(self, ended: Event) -> None:
        assert self.master is not None
        with self.words.open("ab", buffering=0) as file, suppress(OSError):
            while not ended.is_set():
                file.write(os.read(self.master, 4096))


@contextmanager
def attacked_run(
    bench: World, plan: str, place: Path, parent: Path, *, terminal: bool
) -> Iterator[Attacked]:
    """Start a run of a plan in its short form on a served bench; at the end nothing of it lives."""
    short = (*SHORT_FORMS.get(plan, ()), *SHORTER.get(plan, ()))
    changes = [part for one in short for part in ("--set", one)]
    command = station_command("run", plan, *changes, "--non-interactive")
    command += ["--served", str(bench.head), "--output", str(parent)]
    mark, words = uuid.uuid4().hex, place / "words.txt"
    # A bench that is refused after a trip is refused to this run alone.
    around = {**os.environ, "XDG_STATE_HOME": str(place / "state")}
    environment = {**around, MARK: mark, "TERM": "xterm"}
    master = None
    with words.open("wb") as file:
        slave, name = None, ""
        if terminal:
            master, slave = os.openpty()
            termios.tcsetwinsize(slave, (40, 120))
            name = os.ttyname(slave)
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL if slave is None else slave,
            stdout=file if slave is None else slave,
            stderr=file if slave is None else slave,
            env=environment,
            preexec_fn=partial(as_a_person_begins, slave),
        )
        if slave is not None:
            os.close(slave)
    run = Attacked(process, parent, words, mark, around, master, name)
    if terminal:
        run._start_reading()
    try:
        yield run
    finally:
        for pid in [process.pid, *run.others()]:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        process.wait()
        run._drained.set()
        if master is not None:
            os.close(master)


def as_a_person_begins(terminal: int | None) -> None:
    """Give a process what it has from a person's shell: all signals, and perhaps a terminal.

    A campaign in the background is deaf to some, and what it starts would be, too.
    """
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    if terminal is not None:
        os.login_tty(terminal)


def wait_for_step(run: Attacked, step: str) -> bool:
    """Wait until a step begins; False where the run ends before."""
    wanted = f'"event": "step-started", "step": "{step}"'

    def there() -> bool:
        log = None if run.folder is None else run.folder / "events.jsonl"
        if not run.alive:
            return True
        return log is not None and log.is_file() and wanted in log.read_text(encoding="utf-8")

    until(there)
    return run.alive


def processes() -> list[int]:
    """Return the processes that live, one that is only waited for left out."""
    found = [int(one.name) for one in Path("/proc").iterdir() if one.name.isdigit()]
    return [pid for pid in found if (state := stat_of(pid)) and state[0] not in DEAD]


def stat_of(pid: int) -> list[str]:
    """Return what the system says of a process, from its state on; nothing where it is gone."""
    with suppress(OSError):
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        return text.rpartition(")")[2].split()
    return []


def start_of(pid: int) -> int:
    """Return when a process started, in the system's ticks."""
    return int(state[19]) if (state := stat_of(pid)) else 0


def environment_of(pid: int) -> bytes:
    """Return the environment that a process was started with."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/environ").read_bytes()
    return b""


def command_of(pid: int) -> bytes:
    """Return the command line of a process."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def memory_of(pid: int) -> int:
    """Return the address space of a process in bytes."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmSize:"):
            return int(line.split()[1]) * 1024
    raise AssertionError(f"the system does not say how much memory {pid} has")
