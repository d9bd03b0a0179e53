"""Notice that virtual time hangs: no turn passes and whoever has the turn does no work."""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from contextlib import suppress
from threading import Event, Thread, main_thread

from station.clock.turns import Participant, Turns

HANGS_AFTER_S = 6.0
LOOKS_EVERY_S = 0.5
ENDS_AFTER_S = 2.0
WORKING_SHARE = 0.1
"""Who uses this share of a processor computes; it does not hang."""
EXIT_FAULT = 3


class Watchdog:
    """Turn a deadlock into an error that names the waiting threads.

    Threads that wait for their turn raise it themselves. The main thread may be stuck outside of
    virtual time, in a lock of the operating system or a read that nothing answers: it is woken by
    a signal whose handler raises the error there, and time goes on, so that the bench is made
    safe. Where that does not help the process ends, and the simulated bench with it.
    """

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._ended = Event()
        self._thread: Thread | None = None
        self.persons_asked = 0

    def begin(self) -> None:
        """Start watching; a second call does nothing."""
        if self._thread is None:
            self._thread = Thread(target=self._watch, name="clock-watchdog", daemon=True)
            self._thread.start()

    def end(self) -> None:
        """Stop watching."""
        self._ended.set()

    def _watch(self) -> None:
        seen: tuple[object, ...] | None = None
        looks, worked_s = 0, 0.0
        while not self._ended.wait(LOOKS_EVERY_S):
            turns = self._turns
            with turns.mutex:
                state = (turns.passed, turns.in_flight, turns.running)
                idle = turns.running is None and not turns.waiting and not turns.in_flight
                # Nobody has the turn and nothing is under way that could give it to somebody.
                lost = turns.running is None and not turns.in_flight
            # Looks are counted, not seconds: a process that was stopped for a while hangs not.
            looks += 1
            still_s = looks * LOOKS_EVERY_S
            work_s = working_s(turns.running)
            working = not lost and work_s - worked_s > WORKING_SHARE * still_s
            if state != seen or idle or self.persons_asked or (still_s > HANGS_AFTER_S and working):
                seen, looks, worked_s = state, 0, work_s
            elif still_s > HANGS_AFTER_S:
                self._tell()
                if self._turns.failure is not None:
                    return
                seen = None

    def _tell(self) -> None:
        turns, main = self._turns, main_thread().ident
        with turns.mutex:
            running, passed = turns.running, turns.passed
            message = f"time stands still, every thread waits: {turns.describe()}"
            if running is not None:
                message += f"; {running.name} is stuck {place_of(running)}"
            if running is None or main is None or running.thread != main:
                turns.fail(message)
                return
            turns.stuck = message
        print(f"\n{message}", file=sys.stderr, flush=True)
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(main, signal.SIGINT)
        self._ended.wait(ENDS_AFTER_S)
        if turns.stuck is None or turns.running is not running or turns.passed != passed:
            return
        print("nothing wakes the main thread; the process ends here", file=sys.stderr, flush=True)
        os._exit(EXIT_FAULT)


def working_s(running: Participant | None) -> float:
    """Return the processor time of the running participant's thread, or of the whole process."""
    if running is not None and running.thread and hasattr(time, "pthread_getcpuclockid"):
        with suppress(OSError):  # a thread that has just ended has no clock
            return time.clock_gettime(time.pthread_getcpuclockid(running.thread))
    return time.process_time()


def place_of(participant: Participant) -> str:
    """Return where a participant's thread stands: the file, the line and the function."""
    frame = sys._current_frames().get(participant.thread or 0)
    if frame is None:
        return "in a thread that is gone"
    place = traceback.extract_stack(frame)[-1]
    return f"at {place.filename}:{place.lineno} in {place.name}"
