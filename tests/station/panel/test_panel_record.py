"""Viewers come and go, in two languages, on panel and terminal: no byte of the record changes."""

from __future__ import annotations

import contextlib
import json
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest
from command_line import PLAN, begun, station
from panel_server import Served, panel

from station.record.run_names import runs_below

RUN = ("run", "plan.yaml", "--set", "parameters.duration=3000 s", "--non-interactive")
OWN = {"hash", "prev", "time"}
"""What of an event holds the hour of the run."""
HOURLY = {"manifest.json", "report.html", "run.json"}
"""Files that hold the hour of the run, or its name."""
FEWEST_VIEWERS = 12


def look(served: Served, run: str, language: str) -> None:
    """Watch a run for some events, and leave without a word; as a browser that is closed."""
    wish = {"Accept-Language": language}
    for page in (f"/run/{run}", "/api/home", f"/api/run/{run}/plots", f"/api/run/{run}/report"):
        with contextlib.suppress(OSError):  # no report yet
            asked = urllib.request.Request(served.url + page, headers=wish)
            urllib.request.urlopen(asked, timeout=10).read()
    asked = urllib.request.Request(f"{served.url}/api/run/{run}/events", headers=wish)
    with urllib.request.urlopen(asked, timeout=10) as events:
        for _ in range(10):
            events.readline()


def record(run: Path) -> tuple[list[dict[str, Any]], dict[str, bytes]]:
    """Return events and files of a run without the hour at which it was."""
    lines = (run / "events.jsonl").read_text(encoding="utf-8").splitlines()
    events = [{key: at for key, at in json.loads(line).items() if key not in OWN} for line in lines]
    for event in events:
        if event["event"] == "revision-written":
            event.pop("revisions")
            event["files"] = {name: at for name, at in event["files"].items() if name not in HOURLY}
    files = {
        str(path.relative_to(run)): path.read_bytes()
        for path in run.rglob("*")
        if path.is_file() and path.name not in {*HOURLY, "events.jsonl"} and path.suffix != ".h5"
    }
    return events, files


@pytest.mark.campaign
def test_no_byte_of_the_record_changes_while_viewers_come_and_go(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    assert station(tmp_path, *RUN, "--output", "alone").returncode == 0
    watched, viewers = tmp_path / "watched", 0
    watched.mkdir()
    with panel(watched) as served, begun(tmp_path, *RUN, "--output", "watched") as going:
        while going.poll() is None:
            for run in runs_below(watched):
                look(served, run.name, ("zh-CN", "en")[viewers % 2])
                viewers += 1
                if viewers % 4 == 0:
                    attached = begun(tmp_path, "attach", run)
                    station(tmp_path, "status", str(run), LANG=("zh_CN.UTF-8", "C")[viewers % 2])
                    attached.kill()
                    attached.communicate()
            time.sleep(0.05)
        assert going.returncode == 0
        going.communicate()
    (alone,), (other,) = runs_below(tmp_path / "alone"), runs_below(watched)
    assert viewers >= FEWEST_VIEWERS
    assert record(other) == record(alone)
