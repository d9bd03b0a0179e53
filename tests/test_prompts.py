"""What a person may type at a prompt, and what that means."""

from __future__ import annotations

import io
import os
import pty
import sys
import time
from threading import Timer

import pytest

from station.clock import RealClock
from station.errors import Aborted, InputError
from station.procedure import Prompt
from station.runner.prompts import Operator

MOUNT = Prompt("mount", "Mount the gyro.")


def operator() -> Operator:
    return Operator(RealClock(), {}, interactive=True, act=None)


@pytest.mark.parametrize("typed", ["\n", "done\n", " Done \n", "y\n", "YES\n"])
def test_enter_or_done_goes_on(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert operator().ask(MOUNT).text == "done"


@pytest.mark.parametrize("typed", ["no, the probe is missing\n", "not yet\n", "abrot\n", "\x1b\n"])
def test_anything_else_is_asked_again(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{typed}abort\n"))
    with pytest.raises(Aborted, match="ended the run at the prompt mount"):
        operator().ask(MOUNT)


@pytest.mark.parametrize("typed", ["no", "n", "q", "quit", "abort!", "No."])
def test_a_no_ends_the_run(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{typed}\n\n"))
    with pytest.raises(Aborted, match="ended the run at the prompt mount"):
        operator().ask(MOUNT)


@pytest.mark.parametrize("given", ["no", "quit", "abort"])
def test_a_no_in_the_answers_file_ends_the_run(given: str) -> None:
    asked = Operator(RealClock(), {"mount": given}, interactive=False, act=None)
    asked.check([MOUNT])
    with pytest.raises(Aborted, match="the answers file ended the run at the prompt mount"):
        asked.ask(MOUNT)


@pytest.mark.parametrize("given", ["", "maybe", "no, the probe is missing"])
def test_an_answers_file_without_an_answer_is_refused_beforehand(given: str) -> None:
    asked = Operator(RealClock(), {"mount": given}, interactive=False, act=None)
    with pytest.raises(InputError, match="nothing was energised"):
        asked.check([MOUNT])


def test_keys_that_were_pressed_before_a_prompt_are_no_answer_to_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master, terminal = pty.openpty()
    with os.fdopen(terminal, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        os.write(master, b"\n\ndone\n")
        time.sleep(0.2)
        Timer(0.5, os.write, (master, b"abort\n")).start()
        with pytest.raises(Aborted):
            operator().ask(MOUNT)
    os.close(master)


def test_a_terminal_that_is_gone_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("not yet\n"))
    with pytest.raises(Aborted):
        operator().ask(MOUNT)
