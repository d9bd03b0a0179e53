"""What the panel's first page shows: benches with their state, and the newest runs."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

from station import registry
from station.clock import utc_now
from station.errors import InputError
from station.files.faults import FaultList
from station.files.locks import is_held
from station.files.lookup import BENCHES, PLANS, available, find
from station.instruments.bench import Bench, read_bench
from station.panel.reading import first_line, read_json, words
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
        if folder.is_symlink() or not folder.name.isprintable():  # no page can be had of it
            continue
        entry = entry_of(folder)
        if search.lower() in f"{entry['run']} {entry['serial']}".lower():
            found.append(entry)
    return found


def entry_of(folder: Path) -> dict[str, Any]:
    """Return how a run stands, from the first line of its log, its lock and its results."""
    begun = first_event(folder)
    facts = read_json(folder / RUN)
    verdict = words(read_json(folder / RESULTS).get("verdict")) or None
    dut = begun.get("dut")
    try:
        running = is_held(folder / LOCK)
        state = "running" if running else "evaluated" if verdict else "ended without results"
    except (OSError, InputError):
        running, state = False, "its lock cannot be read"
    return {
        "run": folder.name,
        "procedure": words(begun.get("procedure")),
        "bench": words(facts.get("bench_file")),
        "serial": words(dut.get("serial")) if isinstance(dut, dict) else "",
        "started": words(facts.get("started_utc")),
        "running": running,
        "verdict": verdict,
        "state": state,
    }


def first_event(folder: Path) -> dict[str, Any]:
    """Return the first event of a run, nothing where it cannot be read."""
    return first_line(folder / EVENTS)
