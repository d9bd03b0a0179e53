"""What is in flight between a client and a server, and a lock, on virtual time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from threading import get_ident
from typing import Protocol

from station.clock.base import Attendant, Wire
from station.clock.turns import CALLED, SERVES, Participant, Turns
from station.errors import place_of, reason_of

MAX_LOOKS = 20
"""So often a reader that finds nothing looks again for what was written."""


class Participants(Protocol):
    """Which thread is which participant of virtual time."""

    def current(self, attempted: str) -> Participant:
        """Return this thread's participant."""
        ...

    def swap(self, participant: Participant | None) -> Participant | None:
        """Make this thread `participant`, without a turn; return who it was."""
        ...

    def join(self, participant: Participant) -> None:
        """Take the first turn as `participant`."""
        ...

    def left(self, participant: Participant) -> None:
        """Be nobody from now on."""
        ...


class VirtualWire(Wire):
    """Hold time still while requests, or blocks of a stream, are not yet picked up."""

    def __init__(self, clock: Participants, turns: Turns, address: str) -> None:
        self._clock = clock
        self._turns = turns
        self._address = address
        self._sends, self._waits = f"send to {address}", f"wait for {address}"
        self._waiting = f"waiting for an answer of {address}"
        self._open = False
        self._busy = False
        self._to_server = 0
        self._in_stream = 0
        self._answered = 0
        self._sequences: deque[int] = deque()
        self._waiter: Participant | None = None
        self._attendant: Attendant | None = None
        self._server = Participant(address, (SERVES, 0, ""), stoppable=True)
        self._server.at_once = True
        self._listeners: list[Callable[[], bool]] = []
        self._when_opened: list[Callable[[], None]] = []

    def open(self) -> None:
        """Say that a client in this process listens on the wire."""
        with self._turns.mutex:
            self._open = True
        for act in self._when_opened:
            act()

    def when_opened(self, act: Callable[[], None]) -> bool:
        """Have something done in the thread of a client that opens the wire."""
        self._when_opened.append(act)
        return True

    def close(self) -> None:
        """Forget what was in flight: the client is gone."""
        with self._turns.mutex:
            self._open = False
            self._count(-self._unread())
            self._turns.in_flight -= self._in_stream
            self._to_server = self._in_stream = self._answered = 0
            self._sequences.clear()
            attendant, self._attendant = self._attendant, None
            self._listeners = []
            self._turns.pass_on()
        if attendant is not None:
            attendant.dismissed()

    def sent(self, units: int) -> None:
        """Count `units` from the client to the server, before they are written."""
        with self._turns.mutex:
            if self._open:
                if self._attendant is not None:
                    self._clock.current(self._sends).to_serve.append(self._serve)
                self._to_server += units
                self._count(0 if self._busy else units)
                self._sequences.append(self._turns.next_sequence())

    def wait(self, deadline_s: float) -> bool:
        """Give up the turn until an answer lies ready (True) or `deadline_s` is reached (False)."""
        participant = self._clock.current(self._waits)
        with self._turns.mutex:
            if self._answered:
                return True
            self._waiter = participant
            self._turns.park(participant, deadline_s, self._waiting)
        self._turns.take(participant)
        with self._turns.mutex:
            self._waiter = None
            return self._answered > 0

    def received(self) -> None:
        """Take the answer off the wire."""
        with self._turns.mutex:
            self._answered = 0

    def listen(self, read: Callable[[], bool]) -> bool:
        """Have a stream read in the thread that has written to it."""
        self._listeners = [*self._listeners, read]
        return True

    def picked_up(self, units: int) -> None:
        """Take `units` of a stream off the wire."""
        with self._turns.mutex:
            taken = min(units, self._in_stream)
            self._in_stream -= taken
            self._turns.in_flight -= taken
            self._turns.pass_on()

    def serving(self, units: int) -> AbstractContextManager[None]:
        """Take `units` off the wire on the server's side and be the running participant."""
        return Serving(self, units)

    def attend(self, attendant: Attendant) -> bool:
        """Have requests served in the thread that sends them, if this one was sent over here."""
        with self._turns.mutex:
            free = self._open and self._attendant is None and not self._to_server
            if free:
                self._attendant = attendant
            return free

    def _serve(self) -> None:
        """Let the attendant serve what was sent, in the thread that has sent it."""
        sender = self._clock.swap(None)
        attendant = self._attendant
        try:
            while self._to_server and (attendant := self._attendant) is not None:
                if not attendant.look():
                    with self._turns.mutex:
                        self._count(-self._unread())
                        self._attendant = None
                        self._count(self._unread())
                    attendant.dismissed()
        except Exception as error:  # whoever asks must not wait for an answer that never comes
            who = self._address if attendant is None else attendant.name
            why = f"{reason_of(error)}{place_of(error)}"
            self._turns.fail(f"the simulator of {who} has failed: {why}", error)
        finally:
            self._clock.swap(sender)

    def begin_to_serve(self, units: int) -> Participant:
        """Take `units` off the wire; return the participant that deals with them."""
        turns = self._turns
        with turns.mutex:
            sequence = self._sequences.popleft() if self._sequences else turns.next_sequence()
            # What else lies on the wire can only be read when this request is done, so it must
            # not keep the turn from being passed on until then.
            self._count(-self._unread())
            self._busy = True
            self._to_server -= min(units, self._to_server)
            if not self._to_server:
                self._sequences.clear()
            if self._attendant is not None and turns.run_at_once(self._server):
                self._server.thread = get_ident()
                self._clock.swap(self._server)
                return self._server
            server = Participant(self._address, (SERVES, sequence, ""), stoppable=True)
            server.at_once = self._attendant is not None
            turns.park(server, CALLED, "about to serve a request")
        self._clock.join(server)
        return server

    def end_serving(self, server: Participant) -> None:
        """Let what came meanwhile count again, and let others run."""
        with self._turns.mutex:
            self._busy = False
            self._count(self._unread())
            self._turns.leave(server)
        self._clock.left(server)

    def _count(self, units: int) -> None:
        """Count units to the server, by whoever they are going to be read."""
        self._turns.in_flight += units
        if self._attendant is not None:
            self._turns.held += units

    def _unread(self) -> int:
        """Return what the server could read now; nothing while it is busy with a request."""
        return 0 if self._busy else self._to_server

    def answered(self, units: int) -> None:
        """Count an answer of `units` that was written to the client."""
        with self._turns.mutex:
            if self._open and units:
                self._answered += units
                if self._waiter is not None:
                    self._waiter.called()

    def streamed(self, units: int) -> None:
        """Count `units` of a stream, before they are written to the client."""
        with self._turns.mutex:
            if self._open:
                self._in_stream += units
                self._turns.in_flight += units

    def written(self) -> None:
        """Have the stream read until all that was counted is picked up, or nothing more comes."""
        looks = 0
        while self._in_stream and self._listeners and looks < MAX_LOOKS:
            looks = 0 if any(read() for read in self._listeners) else looks + 1


class Serving:
    """One request on the server's side: the running participant from enter to exit."""

    __slots__ = ("_server", "_units", "_wire")

    def __init__(self, wire: VirtualWire, units: int) -> None:
        self._wire, self._units = wire, units

    def __enter__(self) -> None:
        self._server = self._wire.begin_to_serve(self._units)

    def __exit__(self, *_: object) -> None:
        self._wire.end_serving(self._server)


class TurnLock:
    """A lock that gives up the turn while it waits; its waiters follow one another by name."""

    def __init__(self, clock: Participants, turns: Turns, name: str) -> None:
        self._clock = clock
        self._turns = turns
        self._name = name
        self._attempt = f"take the lock {name}"
        self._owner: Participant | None = None
        self._queue: list[Participant] = []

    def __enter__(self) -> None:
        participant = self._clock.current(self._attempt)
        with self._turns.mutex:
            if self._owner is None:
                self._owner = participant
                return
            self._queue.append(participant)
            held = f"waiting for {self._name}, which {self._owner.name} holds"
            self._turns.park(participant, math.inf, held)
        try:
            self._turns.take(participant)
        except BaseException:  # stopped: who never came must not be given the lock, nor keep it
            with self._turns.mutex:
                if participant in self._queue:
                    self._queue.remove(participant)
                elif self._owner is participant:
                    self._hand_on()
            raise

    def __exit__(self, *_: object) -> None:
        with self._turns.mutex:
            self._hand_on()

    def _hand_on(self) -> None:
        self._owner = min(self._queue, key=lambda waiting: waiting.order) if self._queue else None
        if self._owner is not None:
            self._queue.remove(self._owner)
            self._owner.called()
            self._turns.pass_on()
