"""Virtual time: it stands still while anybody works and jumps when everybody waits."""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from threading import Event, Thread, current_thread, local, main_thread

from station.clock.base import Clock, ClockError, ClockStopped, ParticipantThread, Wire
from station.clock.turns import CALLED, NAMED, Participant, Turns
from station.clock.virtual_wire import TurnLock, VirtualWire

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


READ_TIMEOUT_S = 0.05
"""Real time for reading an answer that the wire has already counted as written."""


class VirtualClock(Clock):
    """Run time that costs no real time beyond the work done in it; it begins at `began_s`."""

    def __init__(self, began_s: float = 0.0) -> None:
        self._turns = Turns(began_s)
        self._watchdog = Watchdog(self._turns)
        self._wires: dict[str, VirtualWire] = {}
        self._mine = local()

    def now(self) -> float:
        """Return run time in s."""
        return self._turns.now

    def sleep_until(self, time_s: float) -> None:
        """Give up the turn until `time_s`, or raise what `interrupt` or `stop` asks for."""
        participant = self.current("sleep")
        if self._turns.stopping and participant.stoppable:
            raise ClockStopped
        self._raise_interruption(participant)
        with self._turns.mutex:
            wake_at = max(time_s, self._turns.now)
            participant.sleeping = True
            self._turns.park(participant, wake_at, "sleeping")
        self._turns.take(participant)
        participant.sleeping = False
        self._raise_interruption(participant)

    @contextmanager
    def participant(self, name: str) -> Iterator[None]:
        """Make this thread take part in time until exit."""
        with self.joined(Participant(name, (NAMED, 0, name), stoppable=False)):
            yield

    def start(self, name: str, body: Callable[[], None]) -> ParticipantThread:
        """Start a thread that takes part in time, known to the clock before this returns."""
        participant = Participant(name, (NAMED, 0, name), stoppable=True)
        with self._turns.mutex:
            self._turns.park(participant, CALLED, "about to start")

        def takes_part() -> None:
            with self.joined(participant, parked=True):
                body()

        thread = ParticipantThread(name, takes_part)
        thread.begin()
        return thread

    def repeat(self, name: str, first_s: float, step: Callable[[], float | None]) -> None:
        """Have `step` done in the thread of whoever passes its turn on to it."""

        def as_participant() -> float | None:
            before = self.swap(participant)
            participant.at_once = True
            try:
                return step()
            finally:
                participant.at_once = False
                self.swap(before)

        participant = Participant(name, (NAMED, 0, name), stoppable=True)
        participant.step, participant.sleeping = as_participant, True
        with self._turns.mutex:
            if not self._turns.stopping:
                self._turns.park(participant, max(first_s, self._turns.now), "sleeping")

    def lock(self, name: str) -> AbstractContextManager[object]:
        """Return a lock whose waiting gives up the turn."""
        return TurnLock(self, self._turns, name)

    def wire(self, address: str) -> Wire:
        """Return the wire of a server's address; both of its ends get the same one."""
        with self._turns.mutex:
            if address not in self._wires:
                self._wires[address] = VirtualWire(self, self._turns, address)
            return self._wires[address]

    @contextmanager
    def waiting_for_person(self) -> Iterator[None]:
        """Keep the watchdog quiet: a person may take any time to answer."""
        self._watchdog.persons_asked += 1
        try:
            yield
        finally:
            self._watchdog.persons_asked -= 1

    def real_timeout_s(self, run_seconds: float) -> float:
        """Return the time to read an answer that is already there."""
        return READ_TIMEOUT_S

    def patience_s(self, run_seconds: float) -> float:
        """Return the same span: virtual time waits for whoever works."""
        return run_seconds

    def raise_failure(self) -> None:
        """Raise the error of a time that stands still, wherever this thread is."""
        self._turns.raise_stuck()

    def interrupt(self, error: BaseException | None) -> None:
        """End the main participant's sleep or prompt, now or next, with `error`."""
        super().interrupt(error)
        # A signal handler runs in the main thread, which may hold the mutex, and soon looks itself.
        if error is not None and current_thread() is not main_thread():
            with self._turns.mutex:
                self._turns.wake_main()

    def stop(self) -> None:
        """End every sleep of threads that were started by `start` with ClockStopped."""
        with self._turns.mutex:
            self._turns.stop()
        self._watchdog.end()

    def current(self, attempted: str) -> Participant:
        """Return this thread's participant; ClockError when it takes no part in time."""
        participant: Participant | None = getattr(self._mine, "participant", None)
        if participant is None:
            raise ClockError(
                f"thread {current_thread().name} cannot {attempted}: it takes no part in time; "
                "enter clock.participant(...) first"
            )
        return participant

    @contextmanager
    def joined(self, participant: Participant, *, parked: bool = False) -> Iterator[None]:
        """Take the first turn as `participant`, and leave the order of turns at exit."""
        if not parked:
            self._must_be_outside()
            with self._turns.mutex:
                self._turns.park(participant, CALLED, "about to start")
        self.join(participant)
        try:
            yield
        finally:
            self.leave(participant)

    def join(self, participant: Participant) -> None:
        """Take the first turn as `participant`, which is parked already; it must then leave."""
        self._must_be_outside()
        self._watchdog.begin()
        try:
            self._turns.take(participant)
        except BaseException:
            self.leave(participant)
            raise
        self._mine.participant = participant

    def leave(self, participant: Participant) -> None:
        """Leave the order of turns for good."""
        with self._turns.mutex:
            self._turns.leave(participant)
        self.left(participant)

    def left(self, participant: Participant) -> None:
        """Be nobody from now on, and serve what was still sent."""
        self._mine.participant = None
        participant.serve()

    def swap(self, participant: Participant | None) -> Participant | None:
        """Make this thread `participant`, without a turn; return who it was."""
        before: Participant | None = getattr(self._mine, "participant", None)
        self._mine.participant = participant
        return before

    def _must_be_outside(self) -> None:
        if getattr(self._mine, "participant", None) is not None:
            raise ClockError(f"thread {current_thread().name} already takes part in time")

    def _raise_interruption(self, participant: Participant) -> None:
        if self.interruption is not None and not participant.stoppable:
            error, self.interruption = self.interruption, None
            raise error
