"""How a run stands, told by its log alone, and the log and the lock that this rests on."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from campaign_helpers import only_run, short_plan, station
from command_line import station as station_in
from command_line import station_command
from served_bench import served_bench

from station.clock import VirtualClock
from station.control.status import newest_run, read_status
from station.errors import InputError, RecordError
from station.files.locks import FileLock, LockHeld, is_held
from station.record.events import EventLog, read_events
from station.record.folder import RunFolder, RunRecord
from station.record.layout import LOCK
from station.record.run_state import FinishedUnit, time_left_s

SPEED = 5.0
GIVES_UP_AFTER_S = 60.0


@pytest.fixture
def finished(one_axis_run: Path) -> Path:
    return one_axis_run


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Path:
    return shutil.copytree(finished, tmp_path / finished.name)


def until(true: Callable[[], bool]) -> None:
    for _ in range(round(GIVES_UP_AFTER_S / 0.02)):
        if true():
            return
        time.sleep(0.02)
    raise AssertionError("what the test waits for did not come")


def cut_after(log: Path, kind: str) -> None:
    """Leave the log as it was when an event of a kind was its last."""
    lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
    last = max(n for n, line in enumerate(lines) if json.loads(line)["event"] == kind)
    log.write_text("".join(lines[: last + 1]), encoding="utf-8")


def test_the_status_of_a_finished_run(finished: Path) -> None:
    status = read_status(finished)
    assert (status.state, status.running, status.bench_safe) == ("finished", False, True)
    assert status.procedure == "rlg-magnetic-sensitivity"
    assert status.dut == {"model": "RLG-50", "serial": "SN-0042"}
    assert status.step == "S9"
    assert status.units_finished == ("warm-up", "IA")
    assert status.units_planned == 2
    assert status.remaining_s == 0.0
    assert status.run_time_s == RunFolder(finished).events[-1].time_s


@pytest.mark.campaign
def test_a_run_in_another_process_is_told_while_it_goes_on_and_after_it_was_killed(
    tmp_path: Path,
) -> None:
    plan = short_plan(tmp_path / "plan", axes=["IA"])
    runs = tmp_path / "runs"
    with served_bench(tmp_path, SPEED) as (head, _):
        command = station_command("run", plan, "--non-interactive", "--served", head)
        process = subprocess.Popen(
            [*command, "--output", str(runs)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            until(lambda: only_run(runs) is not None)
            folder = newest_run(runs)
            until(lambda: read_status(folder).step == "S3.1")
            first = read_status(folder)
            time.sleep(0.3)
            second = read_status(folder)
        finally:
            process.kill()
            process.wait()
        until(lambda: read_status(folder).bench_safe is not None)
    assert (first.state, first.running, first.bench_safe) == ("running", True, None)
    assert first.step_title == "Switch the gyro on and warm it up"
    # The warm-up writes no event for a minute: the time that passes is told all the same.
    assert second.run_time_s > first.run_time_s
    assert first.remaining_s is not None and second.remaining_s is not None
    assert 0 < second.remaining_s < first.remaining_s
    killed = read_status(folder)
    assert (killed.state, killed.running, killed.bench_safe) == ("interrupted", False, True)
    assert killed.units_finished == ()
    said = station("status", folder).stdout
    assert "its process is gone" in said
    assert "the guardian made the bench safe and read it back" in said


def test_a_half_written_last_line_changes_nothing(copy: Path) -> None:
    cut_after(copy / "events.jsonl", "unit-started")
    before = read_status(copy)
    assert before.units_finished == ("warm-up",)
    assert before.message == "IA is being recorded"
    with (copy / "events.jsonl").open("ab") as log:
        log.write('{"t_s": 12.5, "event": "µ'.encode()[:-1])
    assert read_status(copy) == before
    assert RunFolder(copy).finished_units().keys() == {"warm-up"}


def test_what_is_left_to_do_is_what_the_steps_are_expected_to_take(copy: Path) -> None:
    cut_after(copy / "events.jsonl", "run-started")
    at_first = read_status(copy).remaining_s
    planned = next(read_events(copy / "events.jsonl")).details["steps"]
    assert at_first == pytest.approx(sum(step["expected_s"] for step in planned), abs=1e-3)


def test_a_bench_that_is_slower_than_the_forecast_is_not_said_to_be_done_early() -> None:
    # Ten units, foreseen to take 10 s each, take 20 s each; the forecast is over after five.
    ends_s = [20.0 * n for n in range(1, 11)]
    told = [
        time_left_s(
            max(100.0 - now_s, 0.0),
            [FinishedUnit(one, 10.0) for one in ends_s if one <= now_s],
            10.0 * left,
            now_s,
        )
        for left, now_s in zip(range(9, -1, -1), ends_s, strict=True)
    ]
    assert told[:2] == [80.0, 60.0]
    assert all(0.3 < one / true <= 1.0 for one, true in zip(told[:-1], ends_s[8::-1], strict=True))
    assert told[-1] == 0.0


def test_short_units_after_long_ones_make_no_run_longer() -> None:
    finished = [FinishedUnit(600.0 * n, 600.0) for n in (1, 2, 3)]
    assert time_left_s(300.0, finished, 300.0, 1800.0) == pytest.approx(300.0)


def test_a_run_that_failed_says_why_last(tmp_path: Path) -> None:
    plan = short_plan(
        tmp_path / "plan",
        warm_up={"slope_limit": "0.0001 deg/h^2", "window": "1 min", "at_most": "2 min"},
    )
    done = station("run", plan, "--non-interactive", "--output", tmp_path / "runs")
    assert done.returncode == 3
    status = read_status(newest_run(tmp_path / "runs"))
    assert (status.state, status.bench_safe) == ("failed", True)
    assert "did not become steady within 2 min" in status.message


def test_the_command_prints_one_json_document_or_a_few_lines(finished: Path) -> None:
    data = json.loads(station("status", finished, "--json").stdout)
    assert data["state"] == "finished"
    assert data["units_finished"] == ["warm-up", "IA"]
    lines = station("status", finished).stdout.splitlines()
    assert "units of work   2 of 2 finished (warm-up, IA)" in lines


def test_without_a_name_it_is_the_newest_run_below_runs(finished: Path) -> None:
    place = finished.parent.parent
    done = station_in(place, "status", "--json")
    assert (place / json.loads(done.stdout)["run"]).samefile(finished)


def test_no_run_at_all_is_a_wrong_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no run below"):
        newest_run(tmp_path)
    done = station("status", tmp_path)
    assert done.returncode == 2
    assert "is no run folder" in done.stderr


def altered(log: Path, change: Callable[[list[str]], None]) -> None:
    lines = log.read_text(encoding="utf-8").splitlines()
    change(lines)
    log.write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_a_changed_value_is_an_altered_log(copy: Path) -> None:
    def change(lines: list[str]) -> None:
        lines[4] = lines[4].replace('"t_s": ', '"t_s": 1')

    altered(copy / "events.jsonl", change)
    with pytest.raises(RecordError, match=r"events\.jsonl:6: the log was altered: line 5 is not"):
        RunFolder(copy)


def test_a_removed_line_is_an_altered_log(copy: Path) -> None:
    altered(copy / "events.jsonl", lambda lines: lines.remove(lines[0]))
    with pytest.raises(RecordError, match="altered: the first line is not the one"):
        RunFolder(copy)


@pytest.mark.parametrize("line", ["no JSON", "[]", "{}", '{"previous": "0"}'])
def test_a_line_that_is_no_event_is_an_altered_log(copy: Path, line: str) -> None:
    def change(lines: list[str]) -> None:
        lines[2] = line

    altered(copy / "events.jsonl", change)
    with pytest.raises(RecordError, match=r"events\.jsonl:3: the log was altered"):
        RunFolder(copy)


def test_a_log_is_gone_on_with_after_its_last_whole_line(copy: Path) -> None:
    log = copy / "events.jsonl"
    before = list(read_events(log))
    with log.open("ab") as file:
        file.write(b'{"t_s": 1.0, "eve')
    again = EventLog(log)
    again.append(5000.0, "run-resumed", {"from": "IA"}, durable=True)
    again.append(5001.0, "unit-started", {"unit": "IA"}, durable=False)
    again.close()
    events = list(read_events(log))
    assert events[: len(before)] == before
    assert [event.kind for event in events[len(before) :]] == ["run-resumed", "unit-started"]


def test_no_line_is_added_to_an_altered_log(copy: Path) -> None:
    altered(copy / "events.jsonl", lambda lines: lines.remove(lines[3]))
    with pytest.raises(RecordError, match="the log was altered"):
        EventLog(copy / "events.jsonl")


@pytest.fixture
def record(tmp_path: Path) -> Iterator[RunRecord]:
    made = RunRecord(tmp_path / "runs", "some-procedure", "SN 1/2", VirtualClock())
    yield made
    made.close()
    made.seal()


def test_a_record_is_locked_until_it_is_sealed(record: RunRecord) -> None:
    assert is_held(record.path / LOCK)
    with pytest.raises(LockHeld, match="in use by another process"):
        FileLock(record.path / LOCK)
    record.close()
    assert is_held(record.path / LOCK)
    record.seal()
    assert not is_held(record.path / LOCK)
    FileLock(record.path / LOCK).release()


def test_asking_for_a_lock_that_is_free_does_not_keep_it(tmp_path: Path) -> None:
    assert not is_held(tmp_path / "missing")
    assert not (tmp_path / "missing").exists()
    lock = FileLock(tmp_path / LOCK)
    lock.release()
    assert not is_held(tmp_path / LOCK)
    assert not is_held(tmp_path / LOCK)


def test_the_lock_is_in_no_manifest(finished: Path) -> None:
    manifest = json.loads((finished / "manifest.json").read_text(encoding="utf-8"))
    assert (finished / LOCK).is_file()
    assert LOCK not in manifest["files"]
