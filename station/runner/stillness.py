"""A run that stands still: notice it, bring the bench to rest without it, and let it be ended.

The thread of the steps may be stuck where no code of its own helps: a disk that answers no more, a
library that never returns. A thread here looks whether all threads of the run give their signs of
life. Where one does not the run is to end; where it does not do so at once, the bench is made safe
from here, over the lines that the run has open. Meanwhile and after that no word goes to the
guardian that the run lives, unless it does: the guardian then ends the process and sees for itself.
"""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable, Sequence
from threading import Event, Thread
from typing import TYPE_CHECKING

from station.clock import Pulse, Quiet, RealClock
from station.console import tell
from station.control.signals import wishes
from station.errors import StationError

if TYPE_CHECKING:
    from station.control.signals import AbortSignals
    from station.safety.safe_state import SafeOutcome

LONGEST_SILENCE_S = 10.0
"""Real time. An exchange takes 0.5 s, a sleep gives signs of life, a disk may have to spin up."""
LOOKS_EVERY_S = 0.25
OBEYS_WITHIN_S = 5.0
"""Real time that a run has to take up a wish that it end."""
REACTS_WITHIN_S = 1.5
STEPS, SAFE_STATE = "the run's steps", "the safe state"


class StoodStill(StationError):
    """A thread of the run gave no sign of life for longer than it may."""


class Stillness:
    """Watch over the signs of life of a run on real time; a context.

    `make_safe` brings the bench to rest from another thread than the steps'.
    """

    def __init__(
        self,
        clock: RealClock,
        signals: AbortSignals,
        make_safe: Callable[[], Sequence[SafeOutcome]],
    ) -> None:
        self._clock = clock
        self._signals = signals
        self._make_safe = make_safe
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

    def __enter__(self) -> Stillness:
        self._before = signal.set_wakeup_fd(self._bell.fileno(), warn_on_full_buffer=False)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        signal.set_wakeup_fd(self._before)
        self._ear.close()
        self._bell.close()

    def begin(self) -> None:
        """From now on the thread of the steps, which calls this, gives signs of life."""
        self._pulse = self._clock.pulse(STEPS, LONGEST_SILENCE_S)

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
            return all(one.name != SAFE_STATE for one in self._quiet)
        return not self._quiet

    def _watch(self) -> None:
        if hasattr(signal, "pthread_sigmask"):  # so that this thread sees those that wait
            signal.pthread_sigmask(signal.SIG_BLOCK, wishes())
        while not self._ended.wait(LOOKS_EVERY_S):
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
        said = f"the run stands still: {' and '.join(map(str, quiet))}"
        tell(said)
        if self._run_ends:  # nothing is done twice at a time; the guardian is next
            return
        if self._clock.interruption is None:  # what a person wished stays what ended the run
            self._clock.interrupt(StoodStill(f"{said}; look at its disk and its instruments"))
        if not any(one.name.startswith(STEPS) for one in quiet):
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
            with self._clock.pulse(SAFE_STATE, LONGEST_SILENCE_S):
                outcomes = self._make_safe()
        finally:
            self._acting = False
        unverified = [one for one in outcomes if not one.verified]
        for one in unverified:
            tell(f"NOT VERIFIED: {one.instrument} could not be proven safe ({one.read_back})")
        if not unverified:
            said = "; ".join(f"{one.instrument} {one.read_back}" for one in outcomes)
            tell(
                "what the run uses was read back as safe, beside its steps: "
                f"{said or 'nothing can harm'}"
            )
