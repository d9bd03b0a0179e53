"""What the panel shows of a run between two events, and what all viewers share."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from panel_server import panel

from station.clock import utc_now
from station.control.status import read_state, read_status
from station.files.locks import FileLock
from station.panel import app
from station.panel.watching import RunWatch
from station.record.events import EventLog

STARTED = {
    "speed": 2.0,
    "steps": [{"step": "S1", "title": "Record", "expected_s": 600.0}],
}
STEP = {"step": "S1", "title": "Record"}


def run_of_a_minute_ago(folder: Path, began_s: float = 0.0) -> Path:
    log = EventLog(folder / "events.jsonl")
    for kind, details in (("run-started", STARTED), ("step-started", STEP)):
        log.append(began_s, kind, details, durable=False)
    log.close()
    past_s = utc_now().timestamp() - 60.0
    os.utime(folder / "events.jsonl", (past_s, past_s))
    return folder


def test_time_goes_on_between_two_events_and_the_end_stays(tmp_path: Path) -> None:
    lock = FileLock(run_of_a_minute_ago(tmp_path) / "run.lock")
    state = json.loads(dict(RunWatch(tmp_path).news({}))["state"])
    lock.release()
    assert state["state"] == "running"
    assert 120 <= state["time_s"] < 200 and 400 < state["left_s"] <= 480
    begun_s = utc_now().timestamp() - 60.0
    assert abs(state["ends"] * 60.0 - begun_s - 300.0) < 45.0


def test_a_bench_that_was_served_for_long_changes_no_time_of_a_run(tmp_path: Path) -> None:
    began_s = 1980.0
    lock = FileLock(run_of_a_minute_ago(tmp_path, began_s) / "run.lock")
    state = json.loads(dict(RunWatch(tmp_path).news({}))["state"])
    status = read_status(tmp_path)
    rest_s = read_state(tmp_path).rest_of_step_s(began_s + status.run_time_s)
    lock.release()
    assert state["began_s"] == began_s
    assert 120 <= state["time_s"] < 200 and 400 < state["left_s"] <= 480
    assert [line["t"] for line in state["log"]] == [0.0, 0.0]
    assert 120 <= status.run_time_s < 200
    assert rest_s is not None and 400 < rest_s <= 480


@pytest.mark.parametrize("numbers", ["a:b:c:d", "1:2", "1:2:3:4:5", f"1:2:3:{'9' * 5000}", ""])
def test_a_mark_that_no_panel_gave_is_as_good_as_none(numbers: str, tmp_path: Path) -> None:
    watch = RunWatch(run_of_a_minute_ago(tmp_path))
    key, _, _ = watch.mark({}).partition(":")
    assert watch.seen_at(f"{key}:{numbers}") == {}
    assert watch.seen_at(f"{key}:1:2:3:4") == {"state": 1, "live": 2, "plots": 3, "unreadable": 4}


def test_nothing_is_left_of_a_run_that_is_gone(tmp_path: Path) -> None:
    state = json.loads(dict(RunWatch(run_of_a_minute_ago(tmp_path)).news({}))["state"])
    assert (state["state"], state["left_s"], state["ends"]) == ("interrupted", None, None)


def test_one_look_does_for_every_first_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[str] = []
    monkeypatch.setattr(app, "newest_runs", lambda _, search="", most=0: looks.append(search) or [])
    monkeypatch.setattr(app, "SEEN_FOR_S", 60.0)
    with panel(tmp_path) as served:
        for path in ("/api/home", "/api/home", "/api/home?search=x"):
            assert served.get(path)[0] == 200
    assert looks == ["", "", "x"]  # the yield is that of all runs
