"""What a technician reads where there is no terminal."""

from __future__ import annotations

import re
import sys
from io import StringIO

import pytest

from station.runner.progress import Progress


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
