"""What a browser wishes of a run reaches it, and a pause waits as long as a unit of work takes."""

from __future__ import annotations

from pathlib import Path

import pytest
from guardian_helpers import until

from station.clock import RealClock
from station.control.channel import ask
from station.control.requests import Control
from station.errors import StationError
from station.panel import run_requests
from station.panel.run_requests import RunRequests
from station.record.folder import RunRecord

SHORT_S = 0.05


def test_a_pause_waits_for_the_end_of_a_unit_of_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_requests, "ANSWERS_WITHIN_S", SHORT_S)
    clock, panel = RealClock(), RunRequests()
    record = RunRecord(tmp_path, "some-procedure", "SN-1", clock)
    with Control(record.path, clock) as control:
        word = panel.pass_on(record.path, "pause", {})
        assert "pauses before its next unit of work" in word["said"]
        assert panel.pass_on(record.path, "pause", {}) == word
        clock.sleep(5 * SHORT_S)
        assert ask(record.path, "live")["pause_requested"]
        request = control.pause_wanted()
        assert request is not None
        request.acknowledge({})
        until(lambda: panel.pass_on(record.path, "pause", {}).get("outcome") == "paused")
        assert not ask(record.path, "live")["pause_requested"]


def test_a_pause_that_is_taken_back_is_not_left_behind(tmp_path: Path) -> None:
    clock, panel = RealClock(), RunRequests()
    record = RunRecord(tmp_path, "some-procedure", "SN-1", clock)
    with Control(record.path, clock) as control:
        panel.pass_on(record.path, "pause", {})
        assert panel.pass_on(record.path, "go-on", {})["outcome"] == "goes-on"
        assert control.pause_wanted() is None


def test_a_wish_to_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StationError, match="no run folder"):
        RunRequests().pass_on(tmp_path, "pause", {})
