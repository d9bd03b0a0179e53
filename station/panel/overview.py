"""What the panel's first page shows: benches with their state, and the newest runs."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

from station import registry
from station.clock import utc_now
from station.files.faults import FaultList
from station.files.lookup import BENCHES, PLANS, available, find
from station.instruments.bench import Bench, read_bench
from station.record.run_list import newest_runs
from station.safety.acknowledgement import addresses_in, unacknowledged

MAX_RUNS = 50


def benches(runs: Path) -> list[dict[str, Any]]:
    """Return each known bench: name, title, whether it is tripped or in use, calibration due."""
    used = {run["bench"]: run["run"] for run in newest_runs(runs, most=MAX_RUNS) if run["running"]}
    rows: list[dict[str, Any]] = []
    for name, _ in available(BENCHES):
        path = find(BENCHES, name)
        try:
            bench = read_bench(path, registry.names(registry.DRIVERS))
        except FaultList as faults:
            rows.append({"name": name, "title": "", "state": "broken", "what": str(faults)})
            continue
        trip = unacknowledged(path, addresses_in(path))
        state, what = "free", ""
        if trip is not None:
            state, what = "tripped", f"{trip.message}; `station acknowledge {name}`"
        elif str(path) in used:
            state, what = "in use", used[str(path)]
        due = earliest_due(bench)
        rows.append(
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
    return rows


def earliest_due(bench: Bench) -> date | None:
    """Return when the first calibration of a bench falls due."""
    records = [
        instrument.calibration
        for instrument in bench.instruments.values()
        if instrument.calibration
    ]
    return min((record.due for record in records if record.due), default=None)


def plans() -> list[dict[str, Any]]:
    """Return each known plan: its name and what it is."""
    return [{"name": name, "title": title} for name, title in available(PLANS)]
