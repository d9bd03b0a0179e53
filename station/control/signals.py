"""A person's wish to end the run: Ctrl-C, a terminal that closes, a polite kill."""

from __future__ import annotations

import _thread
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread, main_thread
from types import FrameType
from typing import Any

from station.clock import Clock
from station.console import tell
from station.errors import Aborted
from station.safety.safe_state import Hurry

HANG_UP = "SIGHUP"
SENT_AGAIN_EVERY_S = 0.2
WISHES = {
    "SIGINT": "Ctrl-C",
    "SIGTERM": "a request of the system to end (SIGTERM)",
    HANG_UP: "the end of its terminal (SIGHUP)",
}
"""Each signal by which a person ends a run, and what the person did."""


def ended_by(cause: str) -> Aborted:
    """Return the error of a run that a person ended, with the sentence that says how."""
    return Aborted(f"the run was ended by {cause}")


@contextmanager
def wishes_end_a_prompt(clock: Clock, prompt_id: str) -> Iterator[None]:
    """Let whatever ends a run end a read from the terminal at once.

    Nothing is held while a person is asked: no wish, no interlock's trip, no folder that is gone.
    """

    taken = Event()

    def heard(number: int, frame: FrameType | None) -> None:
        if not taken.is_set():
            taken.set()
            cause = WISHES[signal.Signals(number).name]
            raise clock.interruption or ended_by(f"{cause} at the prompt {prompt_id}")

    before = {number: signal.signal(number, heard) for number in wishes()}
    clock.ends_prompt = lambda: end_prompt(taken)
    try:
        if clock.interruption is not None:
            raise clock.interruption
        yield
    finally:
        clock.ends_prompt = None
        taken.set()
        for number, handler in before.items():
            signal.signal(number, handler)


def end_prompt(taken: Event) -> None:
    """Wake the main thread from a read of the terminal, as Ctrl-C does, until that is `taken`.

    A signal that comes right before the read begins wakes nobody: it is sent again.
    """
    ident, known = main_thread().ident, wishes()
    if ident is None or not known or not hasattr(signal, "pthread_kill"):
        _thread.interrupt_main()  # heard when the read ends: Windows wakes it for a key only
        return
    number = known[0]

    def again() -> None:
        while not taken.wait(SENT_AGAIN_EVERY_S):
            signal.pthread_kill(ident, number)

    signal.pthread_kill(ident, number)
    with suppress(RuntimeError):  # no memory for a thread: once, then
        Thread(target=again, name="ends the prompt", daemon=True).start()


@contextmanager
def wishes_held() -> Iterator[None]:
    """Let no wish cut short what takes moments and leaves a folder half done."""

    def heard(number: int, frame: FrameType | None) -> None:
        tell(f"{signal.Signals(number).name}: the results are being written; wait")
        if number == signal.SIGINT:  # the bench is safe: nobody has to wait for a disk that hangs
            signal.signal(number, signal.default_int_handler)

    before = {number: signal.signal(number, heard) for number in wishes()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def wishes() -> list[int]:
    """Return the signals by which a person ends a run; SIGHUP is unknown on Windows.

    What was to be ignored when the process began stays so: `nohup`, a shell's background.
    """
    known = [getattr(signal, name) for name in WISHES if hasattr(signal, name)]
    return [int(signal_) for signal_ in known if signal.getsignal(signal_) is not signal.SIG_IGN]


class AbortSignals:
    """End the run at its next wait; once the bench is being made safe, only hurry that."""

    def __init__(self, clock: Clock) -> None:
        self.hurry = Hurry(clock)
        self._clock = clock
        self.heard = 0
        """How many wishes came to the main thread."""
        self.hang_up: Callable[[], bool] = lambda: False
        """Takes note that the terminal is gone; whether the run goes on without it."""
        self._making_safe = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> AbortSignals:
        for number in wishes():
            self._before[number] = signal.signal(number, self._heard)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def hold(self) -> Exception | None:
        """From now on the bench is made safe: no wish ends that.

        Return what was to end the run and was taken up by no wait of its steps.
        """
        self._making_safe = True
        left = self._clock.interruption
        self._clock.interrupt(None)
        return left if isinstance(left, Exception) else None

    def _heard(self, number: int, frame: FrameType | None) -> None:
        self.heard += 1
        # The clock's watchdog sends SIGINT too: to a thread that is stuck where no clock can see.
        self._clock.raise_failure()
        name = signal.Signals(number).name
        if name == HANG_UP and self.hang_up():
            return
        if self._making_safe:
            tell(
                f"\n{name}: the bench is being made safe; that is never skipped, its waits are "
                "cut short"
            )
            self.hurry.ask()
            return
        first = self._clock.interruption
        # The first wish stays the reason: what woke a prompt because of it may come here, late.
        wish = ended_by(WISHES[name])
        self._clock.interrupt(first if isinstance(first, Aborted) else wish)
