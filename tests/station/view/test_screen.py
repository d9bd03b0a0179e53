"""A run on a terminal, as a technician sees it: one picture, readable prompts, whole lines."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from command_line import PLAN, station
from terminal import WITHIN_S, OnTerminal

QUESTIONS = (
    "[mount]",
    "[connect-cables] 1 of 2",
    "[connect-cables] 2 of 2",
    "[connect-cables] Enter",
    "[dut-power-on]",
)
PARTS = ("RLG-50 SN-1", "unit of work ", "interlocks", "read back", "deg/h so far")


def wait_for_line(terminal: OnTerminal, text: str) -> None:
    """Wait until a line of the screen holds a text."""
    until_s = time.monotonic() + WITHIN_S
    while not any(text in line for line in terminal.lines):
        assert time.monotonic() < until_s, f"no {text!r} in\n" + "\n".join(terminal.lines)
        time.sleep(0.02)


@pytest.mark.campaign
def test_prompts_are_readable_the_picture_comes_back_and_the_record_is_the_same(
    tmp_path: Path,
) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    longer = ("run", "plan.yaml", "--set", "parameters.duration=1000 s")  # several pictures long
    terminal = OnTerminal(tmp_path, *longer, "--rehearse")
    for question in QUESTIONS:
        wait_for_line(terminal, question)
        asked = terminal.lines
        assert any(line.startswith(">> ") for line in asked), asked
        assert not any(line.startswith("progress") for line in asked), asked
        time.sleep(0.6)  # longer than a look at the run: nothing is drawn over a prompt
        assert terminal.lines == asked
        terminal.type("yes\n")
    folded = terminal.wrapped  # of questions alone
    for part in PARTS:
        terminal.wait_for(part)
    assert terminal.wrapped == folded
    wait_for_line(terminal, "[dut-power-off]")
    terminal.type("yes\n")
    assert terminal.ended() == 0
    said = [line for line in [*terminal.past, *terminal.lines] if "  S4  Record" in line]
    assert len(said) == 1  # what stays above the picture stays once
    (run,) = (tmp_path / "runs").iterdir()
    assert station(tmp_path, *longer, "--non-interactive", "--output", "alone").returncode == 0
    (alone,) = (tmp_path / "alone").iterdir()
    for raw in sorted((alone / "raw").iterdir()):
        assert (run / "raw" / raw.name).read_bytes() == raw.read_bytes(), raw.name
