"""`station status --watch` on a terminal of either width, and where there is none."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import shutil
import struct
import subprocess
import termios
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import station, station_command

from station.cli.watching import watch_status
from station.files.locks import FileLock
from station.record.layout import EVENTS, LOCK

HIDDEN = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


@pytest.fixture
def copy(one_axis_run: Path, tmp_path: Path) -> Path:
    return shutil.copytree(one_axis_run, tmp_path / one_axis_run.name)


def lines_until_unit(log: str, number: int) -> str:
    """Return a log as it was when its unit of that number was finished, counted from 1."""
    lines = log.splitlines(keepends=True)
    ends = [n for n, line in enumerate(lines) if json.loads(line)["event"] == "unit-finished"]
    return "".join(lines[: ends[number - 1] + 1])


def on_a_terminal(
    folder: Path, columns: int, rows: int, seen: Callable[[str], None] = lambda text: None
) -> list[str]:
    """Return the lines that a terminal of that size is sent, without their colours.

    `seen` is called with what has come so far.
    """
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    size = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    command = station_command("status", str(folder), "--watch")
    process = subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, env={**size, "TERM": "xterm"}
    )
    os.close(theirs)

    text = ""
    while True:
        try:
            chunk = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        if not chunk:
            break
        text += chunk.decode(errors="replace")
        seen(text)
    os.close(ours)
    assert process.wait() == 0, text
    return [line.rstrip() for line in HIDDEN.sub("", text).replace("\r", "\n").split("\n")]


@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (200, 50)])
def test_the_view_fits_its_terminal(copy: Path, columns: int, rows: int) -> None:
    lines = [line for line in on_a_terminal(copy, columns, rows) if line]
    assert max(map(len, lines)) <= columns
    for name, text in (("device", "RLG-50 SN-0042"), ("state", "finished"), ("bench", "")):
        assert any(line.startswith(name) and text in line for line in lines), lines
    assert re.fullmatch(r"read at +\d\d:\d\d:\d\d", lines[-1])
    last = max(n for n, line in enumerate(lines) if line.startswith("run "))
    assert len(lines) - last <= rows


def test_a_running_run_is_drawn_again_in_place_until_it_ends(copy: Path) -> None:
    whole = (copy / EVENTS).read_text(encoding="utf-8")
    (copy / EVENTS).write_text(lines_until_unit(whole, 1), encoding="utf-8")
    lock = FileLock(copy / LOCK)

    def ends(text: str) -> None:
        if "read at" in text and (copy / EVENTS).stat().st_size < len(whole.encode()):
            (copy / EVENTS).write_text(whole, encoding="utf-8")
            lock.release()

    lines = on_a_terminal(copy, 80, 24, ends)
    states = [line.split()[1] for line in lines if line.startswith("state")]
    assert (states[0], states[-1]) == ("running", "finished")
    assert max(map(len, lines)) <= 80


def test_without_a_terminal_a_line_comes_with_every_change_until_the_run_ends(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = copy / EVENTS
    whole = log.read_text(encoding="utf-8")
    states = iter([lines_until_unit(whole, 1), lines_until_unit(whole, 2), whole])
    log.write_text(next(states), encoding="utf-8")
    lock = FileLock(copy / LOCK)
    looks = 0

    def wait() -> None:
        nonlocal looks
        looks += 1
        if looks % 2:  # every other look finds the run as it was
            return
        text = next(states)
        log.write_text(text, encoding="utf-8")
        if text == whole:
            lock.release()

    watch_status(copy, wait)
    lines = capsys.readouterr().out.splitlines()
    assert all(re.match(r"\d\d:\d\d:\d\d  running, S\d", line) for line in lines[:2])
    assert [int(re.findall(r"(\d+) of \d+ units", line)[0]) for line in lines[:2]] == [1, 2]
    assert len(lines) == 3
    assert re.match(r"\d\d:\d\d:\d\d  finished, S9, ", lines[2])


def test_ctrl_c_leaves_the_run_alone(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (copy / EVENTS).read_text(encoding="utf-8")
    (copy / EVENTS).write_text(lines_until_unit(whole, 1), encoding="utf-8")
    before = (copy / EVENTS).read_bytes()
    lock = FileLock(copy / LOCK)

    def wait() -> None:
        raise KeyboardInterrupt

    watch_status(copy, wait)
    lock.release()
    assert "the run is not touched" in capsys.readouterr().err
    assert (copy / EVENTS).read_bytes() == before


def test_watch_and_json_are_refused_together(copy: Path) -> None:
    done = station(copy.parent, "status", str(copy), "--watch", "--json")
    assert done.returncode == 2
    assert "choose one" in done.stderr
