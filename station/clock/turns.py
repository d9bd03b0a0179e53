"""Who runs now: one participant at a time, in an order that no real thread can change."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from itertools import count
from operator import attrgetter
from threading import Lock, Thread, get_ident, main_thread

from station.clock.base import ClockError, ClockStopped
from station.errors import place_of, reason_of

SERVES, NAMED = 0, 1
"""The first part of a participant's order."""
CALLED = -math.inf
"""The time to wake of whoever waits for the turn alone."""
POLL_S = 0.05
"""Real time between two looks of a waiting thread for an interruption or a failure."""


class Participant:
    """One thread's place in the order of turns.

    `order` decides between participants whose time has come: those that serve a request, in the
    order the requests were sent, then the named ones by name. `to_serve` are the requests it has
    sent that its own thread serves when it gives up its turn. Who serves so is `at_once`: it may
    not wait, for it has no thread of its own to wait in. So it is with one that has a `step`, which
    returns when it has its next turn, or None; it is the `duty` of who passes the turn on to it.
    """

    __slots__ = (
        "at_once",
        "doing",
        "duty",
        "name",
        "order",
        "sleeping",
        "step",
        "stoppable",
        "stopped",
        "thread",
        "to_serve",
        "turn",
        "wake_at",
    )

    def __init__(self, name: str, order: tuple[int, int, str], *, stoppable: bool) -> None:
        self.name = name
        self.order = order
        self.stoppable = stoppable
        self.wake_at = math.inf
        self.sleeping = False
        self.stopped = False
        self.at_once = False
        self.step: Callable[[], float | None] | None = None
        self.duty: Participant | None = None
        self.to_serve: deque[Callable[[], None]] = deque()
        self.doing = "starting"
        self.thread: int | None = None
        self.turn = Lock()
        self.turn.acquire()

    @property
    def serves(self) -> bool:
        """Whether it serves a request and may go on."""
        return self.wake_at == CALLED and self.order[0] == SERVES

    def called(self) -> None:
        """Let its event come: it is among the next to run."""
        self.wake_at = CALLED

    def serve(self) -> None:
        """Serve what this participant has sent to those that answer in its thread."""
        while self.to_serve:
            self.to_serve.popleft()()


BY_TIME = attrgetter("wake_at", "order")


class Turns:
    """The scheduler of the virtual clock; every method but `take` needs `mutex` held.

    What is `held` of all that is in flight lies with who answers at once, in the thread that has
    sent it: it keeps time from passing, but no request from being served.
    """

    def __init__(self, began_s: float = 0.0) -> None:
        self.mutex = Lock()
        self.now = began_s
        self.running: Participant | None = None
        self.waiting: list[Participant] = []
        self.in_flight = 0
        self.held = 0
        self.passed = 0
        self.stopping = False
        self.failure: str | None = None
        self.cause: Exception | None = None
        """What made it, whose traceback belongs into the log."""
        self.stuck: str | None = None
        self._sequence = count()

    def next_sequence(self) -> int:
        """Return the next number of an order that is the same in every run."""
        return next(self._sequence)

    def park(self, participant: Participant, wake_at: float, doing: str) -> None:
        """Let `participant` wait until `wake_at` or until it is called."""
        if participant.at_once and wake_at != CALLED:
            raise ClockError(f"{participant.name} answers at once, it cannot be {doing}")
        participant.wake_at = wake_at
        participant.doing = doing
        self.waiting.append(participant)
        if self.running is participant:
            self.running = None
        self.pass_on(participant if participant.step is None else None)

    def pass_on(self, giver: Participant | None = None) -> None:
        """Give the turn to who was called, or let time jump to the earliest sleeper.

        `giver` is who is going to take its next turn now, and can do the step of one without a
        thread before.
        """
        if self.running is not None or self.in_flight > self.held or not self.waiting:
            return
        chosen = min(self.waiting, key=BY_TIME)
        if chosen.wake_at == math.inf or (self.held and not chosen.serves):
            return
        if chosen.wake_at > self.now:
            self.now = chosen.wake_at
        self.waiting.remove(chosen)
        self.running = chosen
        self.passed += 1
        if chosen.step is None:
            chosen.turn.release()
        elif giver is not None:
            giver.duty = chosen
        else:
            Thread(target=self._do_alone, args=(chosen,), name=chosen.name, daemon=True).start()

    def run_at_once(self, participant: Participant) -> bool:
        """Give the turn to `participant` where nobody else could have it, else return False."""
        if self.running is not None or self.in_flight > self.held:
            return False
        for waiting in self.waiting:
            if waiting.wake_at == CALLED:
                return False
        self.running = participant
        self.passed += 1
        return True

    def take(self, participant: Participant) -> None:
        """Block in real time until `participant` has the turn (mutex not held)."""
        participant.thread = get_ident()
        participant.serve()
        while participant.duty is not None:
            self._do_duty(participant)
        while not participant.turn.acquire(timeout=POLL_S):
            if self.failure is not None:
                self._give_up(participant)
        if participant.stopped:
            raise ClockStopped
        self.raise_failure()

    def _give_up(self, participant: Participant) -> None:
        """Wait no more where time has failed: who goes on must not be given a turn, too."""
        with self.mutex:
            if participant in self.waiting:
                self.waiting.remove(participant)
            else:  # it has just been given
                participant.turn.acquire()
        self.raise_failure()

    def _do_duty(self, giver: Participant) -> None:
        """Do the step that the turn was passed on to, and pass it on again (mutex not held)."""
        stepper, giver.duty = giver.duty, None
        assert stepper is not None and stepper.step is not None
        stepper.thread = get_ident()
        next_s: float | None = None
        try:
            next_s = stepper.step()
        except ClockStopped:
            pass
        except Exception as error:
            why = f"{reason_of(error)}{place_of(error)}"
            self.fail(f"{stepper.name} has failed: {why}", error)
        finally:
            with self.mutex:
                if next_s is not None and not self.stopping:
                    stepper.wake_at = max(next_s, self.now)
                    self.waiting.append(stepper)
                self.running = None
                self.pass_on(giver)

    def _do_alone(self, stepper: Participant) -> None:
        helper = Participant(stepper.name, stepper.order, stoppable=True)
        helper.duty = stepper
        while helper.duty is not None:
            self._do_duty(helper)

    def raise_failure(self) -> None:
        """Raise what made time stand still, if anything did (mutex not held)."""
        if self.failure is not None:
            raise ClockError(self.failure) from self.cause

    def raise_stuck(self) -> None:
        """Raise, once, in the main thread what a signal asks for; the others go on."""
        if self.stuck is not None and get_ident() == main_thread().ident:
            message, self.stuck = self.stuck, None
            raise ClockError(message)
        self.raise_failure()

    def wake_main(self) -> None:
        """Let the main participant, where it sleeps, be the next to run."""
        for participant in self.waiting:
            if participant.sleeping and not participant.stoppable:
                participant.called()
        self.pass_on()

    def leave(self, participant: Participant) -> None:
        """Let `participant` go for good."""
        if self.running is participant:
            self.running = None
        elif participant in self.waiting:
            self.waiting.remove(participant)
        self.pass_on()

    def stop(self) -> None:
        """Wake every waiting thread that may be stopped; each ends outside the order of turns."""
        self.stopping = True
        for participant in [participant for participant in self.waiting if participant.stoppable]:
            self.waiting.remove(participant)
            participant.stopped = True
            participant.turn.release()
        self.pass_on()

    def fail(self, message: str, cause: Exception | None = None) -> None:
        """Raise ClockError in every thread that waits, now or later."""
        self.failure, self.cause = message, cause

    def describe(self) -> str:
        """Return who runs, who waits for what, and what is in flight."""
        running = f"{self.running.name} has the turn" if self.running else "nobody runs"
        sleepers = [
            f"{participant.name} is sleeping until {participant.wake_at:.6g} s"
            if participant.sleeping
            else f"{participant.name} is {participant.doing}"
            for participant in self.waiting
        ]
        return f"{running}; {'; '.join(sleepers) or 'nobody waits'}; {self.in_flight} in flight"
