"""Work on instruments beside one another: none waits for one that hangs, none is begun twice."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from threading import Event, Lock, Thread
from typing import Generic, TypeVar

from station.clock import RealClock

LOOKS_EVERY_S = 0.05
Answer = TypeVar("Answer")


def started(body: Callable[[], None], name: str) -> Thread | None:
    """Start a thread that ends with its process; None where there is no room for one."""
    try:
        thread = Thread(target=body, name=name, daemon=True)
        thread.start()
    except (RuntimeError, MemoryError):
        return None
    return thread


@dataclass
class Going(Generic[Answer]):
    """What is known of one instrument: its answers, and how many of them somebody was given."""

    answers: list[Answer] = field(default_factory=list)
    given: int = 0
    over: Event = field(default_factory=Event)


class Beside(Generic[Answer]):
    """Do something with each instrument in threads; what it returns is the instrument's answer.

    One that hangs holds nothing but its own line; it is waited for the next time that it is asked
    for. What it answered when nobody waited any more is given then where it `keeps`, as a line that
    it opened; else it is asked anew: how an instrument stood at some time is no answer later.
    """

    def __init__(self, work: Callable[[str], Answer], *, keeps: bool = True) -> None:
        self._work = work
        self._keeps = keeps
        self._going: dict[str, Going[Answer]] = {}
        self._news = Event()
        self._harvest = Lock()

    def known_so_far(self, name: str, answer: Answer) -> None:
        """Give an answer from within the work, which goes on; its last one is given later."""
        self._going[name].answers.append(answer)
        self._news.set()

    def do(
        self,
        groups: Sequence[Sequence[str]],
        within_s: float,
        waiting: Callable[[], object] = lambda: None,
    ) -> dict[str, Answer]:
        """Return the newest answers that are there, after `within_s` of real time at most.

        Those of one group are done one after the other, also after one that still hangs. `waiting`
        is called now and again, and may raise. Where the system gives no thread the work is done
        here.
        """
        for group in groups:
            self._begin(group)
        real, there = RealClock(), {name: self._going[name] for group in groups for name in group}
        while real.now() < within_s and not all(
            going.over.is_set() or len(going.answers) > going.given for going in there.values()
        ):
            waiting()
            self._news.wait(LOOKS_EVERY_S)
            self._news.clear()
        with self._harvest:
            for name, going in there.items():
                if going.over.is_set():
                    del self._going[name]
                going.given = len(going.answers)
        return {name: going.answers[-1] for name, going in there.items() if going.given}

    def _begin(self, group: Sequence[str]) -> None:
        known = {name: self._going[name] for name in group if name in self._going}
        hangs = [going for going in known.values() if not going.over.is_set()]
        new = [
            name
            for name in group
            if name not in known or (known[name].over.is_set() and not self._keeps)
        ]
        self._going |= {name: Going() for name in new}
        body = partial(self._do_all, new, hangs)
        if new and started(body, f"works on {new[0]}") is None:
            self._do_all(new, ())

    def _do_all(self, names: Sequence[str], after: Sequence[Going[Answer]]) -> None:
        for going in after:
            going.over.wait()
        mine = [self._going[name] for name in names]
        try:
            for name, going in zip(names, mine, strict=True):
                answer = self._work(name)
                with self._harvest:
                    going.answers.append(answer)
                    going.over.set()
                self._news.set()
        finally:
            for going in mine:
                going.over.set()
