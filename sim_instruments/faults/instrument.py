"""The faults of one instrument, and the schedule of those of a whole bench."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from itertools import count

import numpy as np
import numpy.typing as npt

from sim_instruments.faults.lasting import LastingFault
from sim_instruments.faults.wire import WireFault
from station.clock import Clock

Changed = Callable[[float, LastingFault | None], None]


class Schedule:
    """What begins or ends by itself, done in order of time by whoever looks next.

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
            for fault in [one for one in self._waiting if one.trigger.meets(now_s, message)]:
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
