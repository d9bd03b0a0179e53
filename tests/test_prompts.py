"""What a person may type at a prompt, and what that means."""

from __future__ import annotations

import io
import sys

import pytest

from station.clock import RealClock
from station.errors import Aborted
from station.procedure import Prompt
from station.runner.prompts import Operator

MOUNT = Prompt("mount", "Mount the gyro.")


def operator() -> Operator:
    return Operator(RealClock(), {}, interactive=True, act=None)


@pytest.mark.parametrize("typed", ["\n", "done\n", " Done \n"])
def test_enter_or_done_goes_on(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert operator().ask(MOUNT).text == "done"


@pytest.mark.parametrize("typed", ["no\n", "not yet\n", "abrot\n", "q\n", "\x1b\n"])
def test_anything_else_is_asked_again(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{typed}abort\n"))
    with pytest.raises(Aborted, match="ended the run at the prompt mount"):
        operator().ask(MOUNT)


def test_a_terminal_that_is_gone_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("no\n"))
    with pytest.raises(Aborted):
        operator().ask(MOUNT)
