"""Work on instruments beside one another: what hangs is named late, and never begun twice."""

from __future__ import annotations

from collections import Counter
from threading import Event

import pytest

from station.errors import Aborted
from station.instruments import beside
from station.instruments.beside import Beside

WITHIN_S = 20.0
"""Far more than anything here takes: what it is waited for comes, or the test fails."""


def test_one_that_hangs_keeps_no_other_from_its_turn_and_is_not_begun_again() -> None:
    begun: Counter[str] = Counter()
    lets_go = Event()

    def read(name: str) -> str:
        begun[name] += 1
        if name == "hangs":
            lets_go.wait(WITHIN_S)
        return f"{name} {begun[name]}"

    both = Beside(read)
    assert both.do([["hangs"], ["answers"]], 0.3) == {"answers": "answers 1"}
    assert both.do([["hangs"], ["answers"]], 0.3) == {"answers": "answers 2"}
    lets_go.set()
    answers = both.do([["hangs"], ["answers"]], WITHIN_S)
    assert answers == {"hangs": "hangs 1", "answers": "answers 3"}
    assert both.do([["hangs"]], WITHIN_S) == {"hangs": "hangs 2"}


def test_what_answered_when_nobody_waited_is_asked_anew_where_no_answer_is_kept() -> None:
    begun: Counter[str] = Counter()
    lets_go, back = Event(), Event()

    def read(name: str) -> str:
        begun[name] += 1
        if begun[name] == 1:
            lets_go.wait(WITHIN_S)
        return f"{name} {begun[name]}"

    looks = Beside(read, keeps=False)
    assert looks.do([["supply"]], 0.1) == {}
    lets_go.set()
    back.wait(0.2)
    assert looks.do([["supply"]], WITHIN_S) == {"supply": "supply 2"}


def test_nobody_on_a_line_is_begun_while_another_on_it_hangs() -> None:
    at_work: list[str] = []
    lets_go = Event()
    calls: Counter[str] = Counter()

    def read(name: str) -> list[str]:
        calls[name] += 1
        at_work.append(name)
        seen = list(at_work)
        if name == "hangs":
            lets_go.wait(WITHIN_S)
        at_work.remove(name)
        return seen

    line = Beside(read, keeps=False)
    assert line.do([["answers", "hangs"]], 0.2) == {"answers": ["answers"]}
    assert line.do([["answers", "hangs"]], 0.2) == {}
    assert calls == {"answers": 1, "hangs": 1}
    lets_go.set()
    both = line.do([["answers", "hangs"]], WITHIN_S)
    assert both == {"answers": ["answers"], "hangs": ["hangs"]}


def test_work_that_raises_is_begun_again_and_holds_up_nobody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("threading.excepthook", lambda _: None)
    fails = True

    def read(name: str) -> str:
        if fails:
            raise Aborted("a person ended the run")
        return name

    looks = Beside(read)
    assert looks.do([["a", "b"]], WITHIN_S) == {}
    fails = False
    assert looks.do([["a", "b"]], WITHIN_S) == {"a": "a", "b": "b"}


def test_those_of_one_line_take_turns() -> None:
    at_work: list[str] = []

    def read(name: str) -> list[str]:
        at_work.append(name)
        seen = list(at_work)
        Event().wait(0.02)
        at_work.remove(name)
        return seen

    assert Beside(read).do([["a", "b", "c"]], WITHIN_S) == {"a": ["a"], "b": ["b"], "c": ["c"]}


def test_an_early_answer_is_given_once_and_the_last_one_later() -> None:
    lets_go = Event()

    def opens(name: str) -> str:
        opening.known_so_far(name, "switched off")
        lets_go.wait(WITHIN_S)
        return "open"

    opening = Beside(opens)
    assert opening.do([["supply"]], WITHIN_S) == {"supply": "switched off"}
    assert opening.do([["supply"]], 0.1) == {"supply": "switched off"}
    lets_go.set()
    assert opening.do([["supply"]], WITHIN_S) == {"supply": "open"}


def test_without_room_for_a_thread_the_work_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "started", lambda body, name: None)
    assert Beside(str.upper).do([["a", "b"]], WITHIN_S) == {"a": "A", "b": "B"}


def test_whoever_waits_may_be_interrupted() -> None:
    def wish() -> None:
        raise Aborted("a person ended the run")

    lets_go = Event()
    with pytest.raises(Aborted):
        Beside(lambda _: lets_go.wait(WITHIN_S)).do([["hangs"]], WITHIN_S, wish)
    lets_go.set()
