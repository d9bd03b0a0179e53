"""What the panel's first page shows: benches with their state, and the newest runs."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

from station import registry
from station.clock import utc_now
from station.files.faults import FaultList
from station.files.locks import is_held
from station.files.lookup import BENCHES, PLANS, available, find
from station.instruments.bench import Bench, read_bench
from station.record.layout import EVENTS, LOCK, RUN
from station.record.run_names import runs_below
from station.safety.acknowledgement import addresses_in, unacknowledged

MOST_RUNS = 50
RESULTS = "results.json"


def benches(runs: Path) -> list[dict[str, Any]]:
    """Return each known bench: name, title, whether it is tripped or in use, calibration due."""
    used = {one["bench"]: one["run"] for one in newest_runs(runs) if one["running"]}
    found: list[dict[str, Any]] = []
    for name, _ in available(BENCHES):
        path = find(BENCHES, name)
        try:
            bench = read_bench(path, registry.names(registry.DRIVERS))
        except FaultList as faults:
            found.append({"name": name, "title": "", "state": "broken", "what": str(faults)})
            continue
        trip = unacknowledged(path, addresses_in(path))
        state, what = "free", ""
        if trip is not None:
            state, what = "tripped", f"{trip.message}; `station acknowledge {name}`"
        elif str(path) in used:
            state, what = "in use", used[str(path)]
        due = earliest_due(bench)
        found.append(
            {
                "name": name,
                "title": bench.title or "",
                "state": state,
                "what": what,
                "simulated": bench.simulation is not None,
                "due": due.isoformat() if due else None,
                "overdue": bool(due and due < utc_now().date()),
            }
        )
    return found


def earliest_due(bench: Bench) -> date | None:
    """Return when the first calibration of a bench falls due."""
    records = [one.calibration for one in bench.instruments.values() if one.calibration]
    return min((one.due for one in records if one.due), default=None)


def plans() -> list[dict[str, Any]]:
    """Return each known plan: its name and what it is."""
    return [{"name": name, "title": title} for name, title in available(PLANS)]


def newest_runs(runs: Path, search: str = "") -> list[dict[str, Any]]:
    """Return the newest runs, those alone whose name or serial number holds the text."""
    found: list[dict[str, Any]] = []
    for folder in reversed(runs_below(runs)):
        if len(found) >= MOST_RUNS:
            break
        entry = entry_of(folder)
        if search.lower() in f"{entry['run']} {entry['serial']}".lower():
            found.append(entry)
    return found


def entry_of(folder: Path) -> dict[str, Any]:
    """Return how a run stands, from the first line of its log, its lock and its results."""
    begun = first_event(folder)
    facts = read_json(folder / RUN)
    verdict = read_json(folder / RESULTS).get("verdict")
    running = is_held(folder / LOCK)
    dut = begun.get("dut") or {}
    return {
        "run": folder.name,
        "procedure": begun.get("procedure"),
        "bench": facts.get("bench_file", ""),
        "serial": dut.get("serial", ""),
        "started": facts.get("started_utc"),
        "running": running,
        "verdict": verdict,
        "state": "running" if running else "evaluated" if verdict else "ended without results",
    }


def first_event(folder: Path) -> dict[str, Any]:
    """Return the first event of a run, nothing where it cannot be read."""
    try:
        with (folder / EVENTS).open(encoding="utf-8") as log:
            data = json.loads(log.readline())
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}


def read_json(path: Path) -> dict[str, Any]:
    """Return the mapping of a JSON file, empty where it cannot be read."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}
