"""The run's side of its guardian: start it, tell it what to watch, stay alive, dismiss it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Lock, Thread

from station.clock import Clock, RealClock
from station.console import tell
from station.errors import StationError
from station.guardian.messages import BEAT, DISMISS, WATCH, Instructions, said

RESOLVED_BENCH = "bench.resolved.yaml"
BEATS_EVERY_S = 1.0
READY_WITHIN_S = 20.0
ENDS_WITHIN_S = 5.0
A_BEAT = said(BEAT)
"""Made once: where there is no memory left the run may still live."""
LOST = (
    "the guardian of this run has ended: if the run is killed now, nothing makes the bench safe; "
    "end the run with Ctrl-C, or stay beside the bench"
)


class GuardianFailed(StationError):
    """A guardian that cannot do its work; nothing was energised yet."""


class Guardian:
    """A process that makes the bench safe if this one dies or stands still.

    Raises GuardianFailed unless it is ready, its drivers imported, within 20 s; with `wait` False
    only `wait_ready` does. `bench` is the resolved bench file, by default the run folder's;
    `instruments` are those that the run uses, by default all of the bench. `on_lost` is called, in
    a thread of the guardian's own, where the guardian ends before it is dismissed. A sign of life
    is given only where `may_beat` says that the run lives.
    """

    def __init__(
        self,
        folder: Path,
        bench: Path | None,
        addresses: Mapping[str, str],
        clock: Clock,
        *,
        instruments: Sequence[str] | None = None,
        wait: bool = True,
        on_lost: Callable[[str], None] = tell,
        may_beat: Callable[[], bool] = lambda: True,
    ) -> None:
        if not isinstance(clock, RealClock):
            raise GuardianFailed("a bench that is simulated in this process ends with it")
        self._on_lost = on_lost
        self._may_beat = may_beat
        self._ended = Event()
        self._writing = Lock()
        self._ready = False
        self._answers: SimpleQueue[str] = SimpleQueue()
        instructions = Instructions(
            folder=str(folder.absolute()),
            bench=str((bench or folder / RESOLVED_BENCH).absolute()),
            instruments=list(instruments or ()),
            addresses=dict(addresses),
            runner_pid=os.getpid(),
            speed=clock.speed,
            epoch_unix=clock.epoch_unix,
        )
        try:
            self._process = start_process()
            self._write(instructions.to_line())
        except OSError as error:
            raise GuardianFailed(f"the guardian cannot be started: {error}") from error
        for name, body in (("answer", self._read_answer), ("heartbeat", self._beat)):
            Thread(target=body, name=f"guardian {name}", daemon=True).start()
        if wait:
            self.wait_ready()

    def wait_ready(self) -> None:
        """Wait until the guardian has its drivers and can act; raises GuardianFailed."""
        if self._ready:
            return
        try:
            answer = json.loads(self._answers.get(timeout=READY_WITHIN_S) or "{}")
        except Empty:
            answer = {"failed": f"it was not ready within {READY_WITHIN_S:g} s"}
        if not answer.get("ready"):
            why = answer.get("failed", "it ended before it was ready")
            self._process.kill()  # it has nothing to watch yet
            self._end_process()
            raise GuardianFailed(f"the guardian of the run cannot do its work: {why}")
        self._ready = True

    def watch(self, instruments: Sequence[str]) -> None:
        """From now on these are made safe, too, if the run dies; before anything is energised.

        Raises GuardianFailed where the guardian is gone or was never ready.
        """
        self.wait_ready()
        try:
            self._write(said(WATCH, instruments=list(instruments)))
        except OSError as error:
            raise GuardianFailed("the guardian of the run has ended; run again") from error

    def dismiss(self) -> None:
        """Let the guardian go: the run has made the bench safe itself. Takes 5 s at most."""
        if self._ended.is_set():
            return
        with suppress(OSError):
            self._write(said(DISMISS))
        self._end_process()

    def _end_process(self) -> None:
        self._ended.set()
        try:
            self._process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:  # its work is done or was never begun
            self._process.kill()
            self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def _write(self, line: bytes) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        with self._writing:
            left = memoryview(line)
            while left:
                left = left[pipe.write(left) :]

    def _read_answer(self) -> None:
        pipe = self._process.stdout
        assert pipe is not None
        with suppress(OSError, ValueError):
            self._answers.put(pipe.readline().decode())

    def _beat(self) -> None:
        while not self._ended.wait(BEATS_EVERY_S):
            if not self._may_beat():
                continue
            try:
                self._write(A_BEAT)
            except (OSError, ValueError):
                if not self._ended.is_set() and self._ready:
                    self._on_lost(LOST)
                return


def start_process() -> subprocess.Popen[bytes]:
    """Start the guardian where neither Ctrl-C nor a closing terminal reaches it; raises OSError.

    It finds the packages that this process finds, and takes none from the present folder alone.
    """
    places = [place or str(Path.cwd()) for place in sys.path]
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "station.guardian"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        bufsize=0,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
        start_new_session=sys.platform != "win32",
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )
