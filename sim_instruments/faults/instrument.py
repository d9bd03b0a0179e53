"""The faults of one instrument, and where they sit between its logic and its socket."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from itertools import count
from threading import get_ident
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sim_instruments.faults.lasting import LastingFault
from sim_instruments.faults.wire import Reply, WireFault
from station.clock import Clock

Changed = Callable[[float, LastingFault | None], None]


class Schedule:
    """The times of the faults of a whole bench.

    What begins or ends by itself, done in order of time by whoever looks next.

    No thread waits for it: on virtual time one would let time run away before anybody came.
    """

    def __init__(self, clock: Clock, lock: AbstractContextManager[object]) -> None:
        self.clock = clock
        self.lock = lock
        self._due: list[tuple[float, int, Callable[[float], None]]] = []
        self._order = count()
        self._next_s = math.inf

    def add(self, time_s: float, act: Callable[[float], None]) -> None:
        """Have something done at `time_s`."""
        heapq.heappush(self._due, (time_s, next(self._order), act))
        self._next_s = self._due[0][0]

    def catch_up(self) -> None:
        """Do what has become due."""
        if self._next_s > self.clock.now():
            return
        with self.lock:
            now_s = self.clock.now()
            while self._next_s <= now_s:
                time_s, _, act = heapq.heappop(self._due)
                self._next_s = self._due[0][0] if self._due else math.inf
                act(time_s)


class InstrumentFaults:
    """What is wrong with one instrument; its server asks about messages, its model about states."""

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule
        self._clock = schedule.clock
        self._wire: list[WireFault] = []
        self._waiting: list[LastingFault] = []
        self._lasting: dict[str, list[LastingFault]] = {}
        self._changed: dict[str, Changed] = {}
        self.all: list[WireFault | LastingFault] = []
        """Every fault in the order it was added, also those that are over."""

    def when_changed(self, kind: str, act: Changed) -> None:
        """Have `act` called when a lasting fault begins (with it) or the last one ends (None)."""
        self._changed[kind] = act

    def add(self, fault: WireFault | LastingFault, *, at_message: bool) -> None:
        """Take in a fault; `lock` is held. One that lasts begins at a message or at its time."""
        self.all.append(fault)
        if isinstance(fault, WireFault):
            self._wire.append(fault)
            return
        self._lasting.setdefault(fault.kind, []).append(fault)
        if at_message:
            self._waiting.append(fault)
            return
        # Known in advance, so that what is computed late still falls on the right side of it.
        fault.begin(fault.trigger.at_s)
        self._schedule.add(fault.begin_s, lambda time_s: self._begins(fault, time_s))
        self._schedule.catch_up()

    def catch_up(self) -> None:
        """Let what has become due on the bench begin or end."""
        self._schedule.catch_up()

    def later(self, time_s: float, act: Callable[[float], None]) -> None:
        """Have the instrument do something by itself at a time."""
        self._schedule.add(time_s, act)

    def none_to_come(self) -> bool:
        """Let begin or end what has become due; return whether no message can meet a fault."""
        self._schedule.catch_up()
        return not self._waiting and not self._wire

    def arrives(self, message: str) -> bool:
        """Let begin what waits for this message; return whether it is lost on its way in."""
        if self.none_to_come():
            return False
        self.is_on_the_line(message)
        now_s = self._clock.now()
        lossy = [fault for fault in self._live() if fault.loses_messages]
        # All are asked, also after one has struck: each counts its own messages.
        struck = [fault for fault in lossy if fault.trigger.meets(now_s, message)]
        return bool(struck)

    def is_on_the_line(self, message: str) -> None:
        """Let states begin that wait for this message, whichever way it goes."""
        if not self._waiting:
            return
        with self._schedule.lock:
            now_s = self._clock.now()
            for fault in [
                waiting for waiting in self._waiting if waiting.trigger.meets(now_s, message)
            ]:
                self._waiting.remove(fault)
                fault.begin(now_s)
                self._begins(fault, now_s, counted=True)

    @property
    def waited_for(self) -> bool:
        """Whether a message is waited for to begin a state."""
        return bool(self._waiting)

    def live(self) -> list[WireFault]:
        """Return the faults that may still change a reply."""
        return [] if not self._wire else list(self._live())

    def now(self, kind: str) -> LastingFault | None:
        """Return the fault of a kind that is there now."""
        if kind not in self._lasting:
            return None
        now_s = self._clock.now()
        return next((fault for fault in self._lasting[kind] if fault.lasts(now_s)), None)

    def during(self, kind: str, time_s: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Return for each time whether a fault of a kind is there then."""
        there = np.zeros(time_s.shape, dtype=bool)
        for fault in self._lasting.get(kind, ()):
            there |= (time_s >= fault.begin_s) & (time_s < fault.end_s)
        return there

    def _live(self) -> Iterator[WireFault]:
        now_s = self._clock.now()
        self._wire = [fault for fault in self._wire if not fault.trigger.spent(now_s)]
        return iter(self._wire)

    def _begins(self, fault: LastingFault, time_s: float, *, counted: bool = False) -> None:
        if not counted:
            fault.trigger.strike(time_s)
        act = self._changed.get(fault.kind)
        if act is not None:
            act(time_s, fault)
            if math.isfinite(fault.end_s):
                self._schedule.add(fault.end_s, lambda end_s: self._ends(fault.kind, end_s))

    def _ends(self, kind: str, time_s: float) -> None:
        left = [fault for fault in self._lasting[kind] if fault.lasts(time_s)]
        self._changed[kind](time_s, left[0] if left else None)


class Outgoing(NamedTuple):
    """What a line server does after a message: send a reply, end the connection, or neither."""

    reply: Reply | None
    drops: bool = False
    resets: bool = False


class LineTap:
    """The faults of an instrument that answers lines with lines."""

    def __init__(self, faults: InstrumentFaults | None) -> None:
        self._faults = faults
        self._previous = b""

    def exchange(self, line: bytes, execute: Callable[[bytes], bytes], now_s: float) -> Outgoing:
        """Carry out a line, or not, and return what goes out for it."""
        faults = self._faults
        if faults is None or faults.none_to_come():
            answer = execute(line)
            self._previous = answer or self._previous
            return Outgoing(self.parted(answer))
        message = self.named(line)
        if faults.arrives(message):
            return Outgoing(None)
        answer = execute(line)
        live = faults.live()
        reply, drops, resets = self.parted(answer), False, False
        for fault in live:
            if reply is None:
                if fault.needs_reply or not fault.drops_line:
                    continue
            elif fault.loses_messages or not fault.touches(reply):
                continue
            if fault.trigger.meets(now_s, message):
                drops = drops or fault.drops_line
                resets = resets or fault.resets_line
                reply = reply and fault.change(reply, self.parted(self._previous))
        self._previous = answer or self._previous
        return Outgoing(None if drops else reply, drops, resets)

    def named(self, line: bytes) -> str:
        """Return a message as the text that faults are matched against."""
        return line.decode("ascii", "replace").strip()

    def parted(self, answer: bytes) -> Reply | None:
        """Return what may be changed of an answer, and its end; None for no answer."""
        return reply_of(answer)


class FrameTap:
    """The faults of an instrument whose line carries frames both ways, each with a name.

    A fault that meets a frame to the instrument changes all that the instrument sends while it
    deals with it; else a fault meets the frames that the instrument sends.
    """

    def __init__(self, faults: InstrumentFaults) -> None:
        self._faults = faults
        self._previous: dict[str, Reply] = {}
        self._answering: tuple[int, list[WireFault]] = (0, [])

    def arrives(self, name: str, receive: Callable[[], None], now_s: float) -> bool:
        """Give a frame to the instrument, or not; return whether the connections end with it."""
        if self._faults.arrives(name):
            return False
        others = [fault for fault in self._faults.live() if not fault.loses_messages]
        met = [fault for fault in others if fault.trigger.meets(now_s, name)]
        self._answering = (get_ident(), met)
        try:
            receive()
        finally:
            self._answering = (0, [])
        return any(fault.drops_line for fault in met)

    def idle(self) -> bool:
        """Return whether no fault can meet a frame that leaves now."""
        return not (self._faults.live() or self._met() or self._faults.waited_for)

    def leaves(self, name: str, frame: Reply, now_s: float) -> tuple[Reply | None, bool]:
        """Return what goes out in place of a frame, and whether the connections end with it."""
        self._faults.is_on_the_line(name)
        met = self._met()
        going: Reply | None = frame
        drops = False
        for fault in [*met, *(fault for fault in self._faults.live() if fault not in met)]:
            if going is None:
                break
            if fault in met or fault.trigger.meets(now_s, name):
                drops = drops or fault.drops_line
                going = fault.change(going, self._previous.get(name))
        self.left(name, frame)
        return going, drops

    def left(self, name: str, frame: Reply) -> None:
        """Keep a frame that the instrument sent, for a fault that repeats it."""
        self._previous[name] = frame

    def _met(self) -> list[WireFault]:
        thread, met = self._answering
        return met if thread == get_ident() else []


def reply_of(answer: bytes) -> Reply | None:
    """Return the line and its end apart; None for no answer."""
    if not answer:
        return None
    body = answer.rstrip(b"\r\n")
    return Reply(body, answer[len(body) :])
