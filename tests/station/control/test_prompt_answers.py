"""A prompt with a checklist, a value with its range, and what may be answered to it."""

from __future__ import annotations

import io
import sys

import pytest

from station.clock import RealClock
from station.control.channel import Incoming
from station.control.questions import Operator, PromptQueue
from station.errors import Aborted, InputError
from station.method.prompts import AskedValue, Asking, Prompt

HEAT = Prompt("heat", "Heat the cell.", value=AskedValue("cell temperature", "degC", 20.0, 250.0))
MOUNT = Prompt(
    "mount", "Mount it.", checklist=("It is bolted.", "Nobody is near."), then="the table turns"
)


def at_terminal(monkeypatch: pytest.MonkeyPatch, prompt: Prompt, typed: str) -> str:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    return Operator(RealClock(), {}, interactive=True, act=None).ask(prompt).text


@pytest.mark.parametrize("typed", ["110", "110 degC", "\n85 K\n300\n19.9\ndone\n1e999\n110"])
def test_a_value_is_taken_within_its_range_alone(
    typed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert at_terminal(monkeypatch, HEAT, typed + "\n") == "110 degC"


def test_a_no_ends_the_run_where_a_value_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Aborted):
        at_terminal(monkeypatch, HEAT, "no\n")


def test_each_line_of_a_checklist_is_confirmed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert at_terminal(monkeypatch, MOUNT, "\nwhat\ny\n\n") == "done"
    said = capsys.readouterr().err
    order = [">> Mount it.", "next: the table turns", "1 of 2: It is bolted.", "2 of 2: Nobody"]
    assert [said.index(one) for one in order] == sorted(said.index(one) for one in order)
    assert said.count("2 of 2") == 2, "what is no answer is asked again"


def test_a_no_to_a_line_of_a_checklist_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Aborted):
        at_terminal(monkeypatch, MOUNT, "\nno\n\n\n")


def test_a_checklist_alone_is_not_the_answer() -> None:
    asking = Asking(MOUNT)
    assert [asking.take(one) for one in ("", "", "")] == [None, None, "done"]


@pytest.mark.parametrize(("given", "answer"), [("110 degC", "110 degC"), ("done", "done")])
def test_an_answers_file_gives_the_value_or_says_done(given: str, answer: str) -> None:
    asked = Operator(RealClock(), {"heat": given}, interactive=False, act=None)
    asked.check([HEAT])
    assert asked.ask(HEAT).text == answer


def test_an_answers_file_with_a_value_out_of_range_is_refused_beforehand() -> None:
    asked = Operator(RealClock(), {"heat": "300 degC"}, interactive=False, act=None)
    with pytest.raises(InputError, match="heat: 300 degC"):
        asked.check([HEAT])


def test_a_desk_refuses_a_value_out_of_range_and_says_the_range() -> None:
    desk = PromptQueue(RealClock())
    desk._asked = HEAT
    for text, outcome in (("300", "no-answer"), ("done", "no-answer"), ("110 degC", "taken")):
        incoming = Incoming("answer", {"id": "heat", "text": text})
        desk.take(incoming)
        assert incoming.final["outcome"] == outcome
        assert outcome == "taken" or "20 degC to 250 degC" in incoming.final["said"]
    assert desk._answer == "110 degC"


@pytest.mark.parametrize("prompt", [HEAT, MOUNT, Prompt("a", "b")])
def test_a_prompt_of_the_log_is_the_prompt_that_was_shown(prompt: Prompt) -> None:
    assert Prompt.from_data({**prompt.to_data(), "of": "step"}) == prompt
