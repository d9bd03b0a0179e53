"""`station status --watch` on a terminal of either width, and where there is none."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from command_line import station
from terminal import OnTerminal

from station.cli.watching import follow_status, watch_status
from station.files.locks import FileLock
from station.record.layout import EVENTS, LOCK
from station.speech import cells, folded


@pytest.fixture
def copy(one_axis_run: Path, tmp_path: Path) -> Path:
    return shutil.copytree(one_axis_run, tmp_path / one_axis_run.name)


def lines_until_unit(log: str, number: int) -> str:
    """Return a log as it was when its unit of that number was finished, counted from 1."""
    lines = log.splitlines(keepends=True)
    ends = [n for n, line in enumerate(lines) if json.loads(line)["event"] == "unit-finished"]
    return "".join(lines[: ends[number - 1] + 1])


@pytest.mark.campaign
@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (200, 50)])
def test_a_run_is_drawn_in_place_until_it_ends(copy: Path, columns: int, rows: int) -> None:
    whole = (copy / EVENTS).read_text(encoding="utf-8")
    (copy / EVENTS).write_text(lines_until_unit(whole, 1), encoding="utf-8")
    lock = FileLock(copy / LOCK)
    terminal = OnTerminal(copy, "status", copy, "--watch", columns=columns, rows=rows)
    terminal.wait_for("gyro_acquisition rate")  # the last part of a picture
    first = terminal.lines
    assert re.match(r"state +▶ running +device RLG-50 SN-0042 +[0-9:]{8}$", first[0]), first
    (copy / EVENTS).write_text(whole, encoding="utf-8")
    lock.release()
    assert terminal.ended() == 0
    last = terminal.lines
    assert re.match(r"state +✔ finished +device RLG-50 SN-0042 +[0-9:]{8}$", last[0]), last
    assert len([line for line in last if line.startswith("state")]) == 1
    assert "✔ the bench is safe, read back from every instrument that can harm" in last
    assert (terminal.wrapped, terminal.past) == (0, [])


@pytest.mark.parametrize("columns", [40, 80])
def test_the_state_is_folded_to_the_width_of_the_terminal(copy: Path, columns: int) -> None:
    terminal = OnTerminal(copy, "status", copy, columns=columns)
    assert (terminal.ended(), terminal.wrapped) == (0, 0)
    told = " ".join(" ".join(terminal.lines).split())
    assert "bench safe, read back from every instrument that can harm" in told


@pytest.mark.parametrize("width", [20, 24, 64])
@pytest.mark.parametrize(
    "text",
    [
        "runs/20261127T132510Z-rlg-magnetic-sensitivity-SN-0042",
        "安全，凡可能造成危害的仪器均已回读（不含 coil_supply.x），请查看 S9  线圈和陀螺断电",
        "",
    ],
)
def test_nothing_folded_is_wider_than_its_column_and_nothing_is_lost(text: str, width: int) -> None:
    lines = folded(text, width, indent=2).split("\n  ")
    assert max(map(cells, lines)) <= width
    assert "".join("".join(lines).split()) == "".join(text.split())


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


def test_each_change_is_one_document_in_a_line_until_the_run_ends(
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
        if looks % 2:  # every other look sees the run as it was
            return
        text = next(states)
        log.write_text(text, encoding="utf-8")
        if text == whole:
            lock.release()

    follow_status(copy, wait)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["state"] for line in told] == ["running", "running", "finished"]
    assert [len(line["units_finished"]) for line in told[:2]] == [1, 2]
    assert [line["bench_safe"] for line in told] == [None, None, True]
    assert all(line["utc"] and line["prompt"] is None for line in told)


def test_a_run_that_dies_is_the_last_line_of_who_follows_it(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = (copy / EVENTS).read_text(encoding="utf-8")
    (copy / EVENTS).write_text(lines_until_unit(whole, 1), encoding="utf-8")
    lock = FileLock(copy / LOCK)
    follow_status(copy, lock.release)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["state"] for line in told] == ["running", "interrupted"]
    assert told[-1]["bench_safe"] is None


def test_following_is_for_programs_alone(copy: Path) -> None:
    for others in ((), ("--watch", "--json")):
        done = station(copy.parent, "status", str(copy), "--follow", *others)
        assert (done.returncode, "goes with `--json`" in done.stderr) == (2, True)
    done = station(copy.parent, "status", str(copy), "--follow", "--json")
    assert json.loads(done.stdout)["state"] == "finished"


def test_ctrl_c_leaves_the_run_alone(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (copy / EVENTS).read_text(encoding="utf-8")
    (copy / EVENTS).write_text(lines_until_unit(whole, 1), encoding="utf-8")
    before = (copy / EVENTS).read_bytes()
    lock = FileLock(copy / LOCK)

    def wait() -> None:
        raise KeyboardInterrupt

    watch_status(copy, wait)
    lock.release()
    assert "the run is not affected" in capsys.readouterr().err
    assert (copy / EVENTS).read_bytes() == before


def test_watch_and_json_are_refused_together(copy: Path) -> None:
    done = station(copy.parent, "status", str(copy), "--watch", "--json")
    assert done.returncode == 2
    assert "choose one" in done.stderr
