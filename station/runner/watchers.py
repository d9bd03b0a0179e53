"""Watch a run: its signs of life, its folder, and that the computer does not go to sleep.

The thread of the steps may be stuck where no code of its own helps: a disk that answers no more, a
library that never returns. A thread here looks whether all threads of the run give their signs of
life. Where one does not the run is to end; where it does not do so at once, the bench is made safe
from here, over the lines that the run has open. Meanwhile and after that no word goes to the
guardian that the run lives, unless it does: the guardian then ends the process and sees for itself.

A laptop that sleeps stops the run and its guardian, and leaves the instruments as they are.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Event, Thread
from typing import TYPE_CHECKING

from station.clock import Clock, Pulse, Quiet, RealClock, boot_seconds
from station.console import tell
from station.control.signals import wishes
from station.errors import RecordError, StationError
from station.record.folder import RunRecord

if TYPE_CHECKING:
    from station.control.signals import AbortSignals
    from station.safety.safe_state import SafeOutcome


MAX_SILENCE_S = 10.0
"""Real time. An exchange takes 0.5 s, a sleep gives signs of life, a disk may have to spin up."""
LOOKS_EVERY_S = 0.25
MISSES_S = 5.0
"""Real time; a process that is not stopped, on a computer that does not sleep, looks sooner."""
OBEYS_WITHIN_S = 5.0
"""Real time that a run has to take up a wish that it end."""
REACTS_WITHIN_S = 1.5
STEPS, SAFE_STATE = "the run's steps", "the safe state"


class RunStalled(StationError):
    """A thread of the run did not respond for longer than it may."""


class StallWatch:
    """Watch over the signs of life of a run on real time; a context.

    `make_safe` brings the bench to rest from another thread than the steps'. `missed` is called
    with the seconds for which nothing of this process ran at all.
    """

    def __init__(
        self,
        clock: RealClock,
        signals: AbortSignals,
        make_safe: Callable[[], Sequence[SafeOutcome]],
        missed: Callable[[float], None] = lambda seconds: None,
    ) -> None:
        self._clock = clock
        self._signals = signals
        self._make_safe = make_safe
        self._missed = missed
        self._pulse: Pulse | None = None
        self._ended, self._due = Event(), Event()
        self._run_ends, self._acting = False, False
        self._quiet: tuple[Quiet, ...] = ()
        # A wish reaches the main thread when that runs; this hears of it in any case.
        self._ear, self._bell = socket.socketpair()
        self._ear.setblocking(False)
        self._bell.setblocking(False)
        self._before = -1
        self._heard = 0
        self._looks = self._looks_at_beat = 0
        self._looks_since_wish: int | None = None
        # Both threads are there before there may be no memory for them.
        for name, body in (("stillness", self._watch), ("standstill", self._bring_to_rest)):
            Thread(target=body, name=name, daemon=True).start()

    def __enter__(self) -> StallWatch:
        self._before = signal.set_wakeup_fd(self._bell.fileno(), warn_on_full_buffer=False)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        signal.set_wakeup_fd(self._before)
        self._ear.close()
        self._bell.close()

    def begin(self) -> None:
        """From now on the thread of the steps, which calls this, gives signs of life."""
        self._pulse = self._clock.pulse(STEPS, MAX_SILENCE_S)

    def run_ends(self) -> None:
        """From now on the run itself makes the bench safe; where that stands still, so does it."""
        self._run_ends = True

    def end(self) -> None:
        """Watch no more: the bench is safe, or somebody else's."""
        self._ended.set()
        self._due.set()
        if self._pulse is not None:
            self._pulse.end()

    def may_beat(self) -> bool:
        """Whether the guardian may be informed that the run lives.

        A run that stands still is not ended while it is being brought to rest from here. Nor does
        it live where nobody has looked since the last time.
        """
        if self._ended.is_set():
            return True
        looks, self._looks_at_beat = self._looks_at_beat, self._looks
        if looks == self._looks:
            return False
        if self._acting:
            return all(quiet.name != SAFE_STATE for quiet in self._quiet)
        return not self._quiet

    def _watch(self) -> None:
        if hasattr(signal, "pthread_sigmask"):  # so that this thread sees those that wait
            signal.pthread_sigmask(signal.SIG_BLOCK, wishes())
        looked_s = boot_seconds()
        while not self._ended.wait(LOOKS_EVERY_S):
            before_s, looked_s = looked_s, boot_seconds()
            if looked_s - before_s > MISSES_S:
                self._missed(looked_s - before_s)
            quiet = self._clock.quiet_pulses()
            if not quiet and self._disobeyed():
                quiet = (Quiet(f"{STEPS}, asked to end,", OBEYS_WITHIN_S),)
            begins = bool(quiet) and not self._quiet
            self._quiet = quiet
            self._looks += 1
            if begins:
                self._stop(quiet)

    def _stop(self, quiet: Sequence[Quiet]) -> None:
        """End the run, or bring its bench to rest where it cannot."""
        text = f"the run stands still: {' and '.join(map(str, quiet))}"
        tell(text)
        if self._run_ends:  # nothing is done twice at a time; the guardian is next
            return
        if self._clock.interruption is None:  # what a person wished stays what ended the run
            self._clock.interrupt(RunStalled(f"{text}; look at its disk and its instruments"))
        if not any(thread.name.startswith(STEPS) for thread in quiet):
            self._ended.wait(REACTS_WITHIN_S)
        if not self._run_ends:
            self._acting = True
            self._due.set()

    def _disobeyed(self) -> bool:
        """Whether somebody wished that the run end, and it does not take that up in time."""
        rung = self._rung()
        if self._signals.heard != self._heard:
            self._heard, rung = self._signals.heard, False
        if self._run_ends or self._pulse is None:
            return False
        if self._looks_since_wish is None:
            if rung or self._clock.interruption is not None:
                self._looks_since_wish = 0
            return False
        self._looks_since_wish += 1
        return self._looks_since_wish * LOOKS_EVERY_S > OBEYS_WITHIN_S

    def _rung(self) -> bool:
        """Whether a wish has come since the last look, or waits for a thread in the kernel."""
        known = set(wishes())
        if hasattr(signal, "sigpending") and known & signal.sigpending():
            return True
        try:
            return bool(known & set(self._ear.recv(4096)))
        except OSError:  # nothing has, or all is over
            return False

    def _bring_to_rest(self) -> None:
        self._due.wait()
        if self._ended.is_set():
            return
        try:
            with self._clock.pulse(SAFE_STATE, MAX_SILENCE_S):
                outcomes = self._make_safe()
        finally:
            self._acting = False
        unverified = [outcome for outcome in outcomes if not outcome.verified]
        for outcome in unverified:
            tell(
                f"NOT VERIFIED: {outcome.instrument} could not be proven safe ({outcome.read_back})"
            )
        if not unverified:
            text = "; ".join(f"{outcome.instrument} {outcome.read_back}" for outcome in outcomes)
            tell(
                "what the run uses was read back as safe, beside its steps: "
                f"{text or 'nothing can harm'}"
            )


FOLDER_EVERY_S = 1.0
DISK_SILENCE_S = 10.0
"""Real time in which its disk has to answer."""


class FolderWatch:
    """Look once a second in a thread of its own, which a disk may hold up; a context."""

    def __init__(self, record: RunRecord, clock: Clock) -> None:
        self._record = record
        self._clock = clock
        self._ended = Event()

    def __enter__(self) -> FolderWatch:
        Thread(target=self._watch, name="run folder", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Look no more."""
        self._ended.set()

    def _watch(self) -> None:
        with self._clock.pulse("the disk of the run folder", DISK_SILENCE_S) as pulse:
            while not self._ended.wait(FOLDER_EVERY_S):
                pulse.beat()
                try:
                    self._record.presence.check()
                except RecordError as error:
                    if not self._ended.is_set():
                        self._clock.interrupt(error)
                    return


WHAT = "sleep:idle"


class StayingAwake:
    """A request that the computer stay awake until this process ends; it never fails a run."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self.problem = ""
        """Why the system was not asked, as far as is known at once."""
        if sys.platform == "win32":
            import ctypes

            continuous, system_required = 0x80000000, 0x1
            asked = ctypes.windll.kernel32.SetThreadExecutionState(continuous | system_required)
            self.problem = "" if asked else "the system refuses"
            return
        command = command_for(sys.platform)
        if not shutil.which(command[0]):
            self.problem = f"there is no {command[0]}"
            return
        try:
            # The request lasts until the pipe closes: with this process, however it ends.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            self.problem = f"{command[0]}: {error.strerror or error}"

    def refused(self) -> str:
        """Return why the computer may sleep all the same, empty where nothing is known of that."""
        if self._process is not None and not self.problem and self._process.poll() is not None:
            self.problem = f"{command_for(sys.platform)[0]} ended with {self._process.returncode}"
        return self.problem

    def end(self) -> None:
        """Let the computer sleep again."""
        if self._process is not None:
            with suppress(OSError):
                assert self._process.stdin is not None
                self._process.stdin.close()
            self._process.kill()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)


def command_for(platform: str) -> list[str]:
    """Return the program that keeps a system awake until this process ends, or it is killed."""
    if platform == "darwin":
        return ["caffeinate", "-i", "-s", "-w", str(os.getpid())]
    why = "instruments are energised"
    who = "--who=Inertial Station"
    return ["systemd-inhibit", f"--what={WHAT}", who, f"--why={why}", "--mode=block", "cat"]
