"""What a technician reads on a narrow terminal."""

from __future__ import annotations

import re
import sys
from io import StringIO

import pytest
from rich.console import Console

from station.runner.progress import LEFT_WIDTH, Progress, doing

TITLE = "S4  Record N samples of the gyro, and the field beside it"


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_lines_are_never_cut_within_a_word() -> None:
    words = {*TITLE.split(), *["S4", "IA:", "the", "field", "settles"]}
    for room in range(8, 90):
        for detail in ("", "IA: the field settles"):
            said = doing("S4", TITLE, detail, room)
            assert len(said) <= room
            shown = said.removesuffix("…").split()
            assert all(one in words or f"{one}," in words or f"{one}:" in words for one in shown)
    assert doing("S4", TITLE, "IA: the field settles", 27) == "S4  IA: the field settles"
    assert doing("S4", TITLE, "", 27) == "S4  Record N samples of…"
    assert doing("S4", "S4  Unbreakableword", "", 10) == "S4…"


@pytest.mark.parametrize("elapsed_s", [10.0, 500.0])
def test_a_bar_of_80_columns_shows_the_time_left_and_whole_words(
    elapsed_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm")
    progress = Progress(100.0)
    progress.step("S4", TITLE.removeprefix("S4  "), 100.0)
    progress.at(elapsed_s, "IA: the field settles")
    assert progress._bar is not None
    shown = Console(width=80, file=StringIO(), record=True)
    shown.print(progress._bar.get_renderable())
    (line,) = [one for one in shown.export_text().splitlines() if one.strip()]
    assert line.rstrip().endswith("S4  IA: the field settles")
    assert ("bench time left 1 min 30 s" if elapsed_s < 100.0 else "left not known") in line
    assert len(line) <= 80 and LEFT_WIDTH < 40


def test_without_a_terminal_a_line_a_unit_of_work_with_the_time_of_day(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log, seconds = StringIO(), [100.0]
    monkeypatch.setattr(sys, "stderr", log)
    monkeypatch.setattr("station.runner.progress.boot_seconds", lambda: seconds[0])
    progress = Progress(400.0, units={"IA": 100.0, "NA": 100.0})
    progress.step("S4", "Record", 200.0)
    for look in range(100):  # within a minute, and within a unit of work
        progress.at(float(look), "IA")
    progress.unit_finished("IA")
    progress.at(100.0, "NA")
    progress.at(101.0, "NA")
    seconds[0] += 61.0
    progress.at(162.0, "NA")
    title, first, later = log.getvalue().splitlines()
    assert re.fullmatch(r"\d\d:\d\d:\d\d  S4  Record", title)
    assert re.fullmatch(r"\d\d:\d\d:\d\d       25 %  bench time left .*  NA", first)
    assert "NA" in later
