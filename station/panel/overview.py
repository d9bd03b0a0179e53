"""What the panel's first page shows: benches with their state, plans, what runs came to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from station import registry
from station.clock import local_time, utc_now
from station.errors import StationError
from station.files.faults import FaultList
from station.files.lookup import BENCHES, PLANS, available, find
from station.files.plan.composition import layers_of, merged
from station.files.yaml.reading import read_yaml
from station.instruments.bench import Bench, read_bench
from station.panel.access import Role
from station.record.careful_reading import read_json, words
from station.record.run_list import RESULTS, newest_runs
from station.safety.acknowledgement import addresses_in, unacknowledged

MAX_RUNS = 50


def benches(newest: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return each known bench: name, title, whether it is tripped or in use, calibration due.

    `newest` are the newest runs, as they are listed.
    """
    used = {run["bench"]: run["run"] for run in newest if run["running"]}
    rows: list[dict[str, Any]] = []
    for name, _ in available(BENCHES):
        path = find(BENCHES, name)
        try:
            bench = read_bench(path, registry.names(registry.DRIVERS))
        except FaultList as faults:
            broken = {"state": "broken", "what": str(faults), "due_days": None}
            rows.append({"name": name, "title": "", **broken})
            continue
        trip = unacknowledged(path, addresses_in(path))
        state, what = "free", ""
        if trip is not None:
            state, what = "tripped", f"{trip.message}; `station acknowledge {name}`"
        elif str(path) in used:
            state, what = "in use", used[str(path)]
        due = earliest_due(bench)
        due_days = (due - utc_now().date()).days if due else None
        rows.append(
            {
                "name": name,
                "title": bench.title or "",
                "state": state,
                "what": what,
                "simulated": bench.simulation is not None,
                "due_days": due_days,
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


def plans(role: Role) -> list[dict[str, Any]]:
    """Return each plan that a role may start: its name and its title."""
    rows = []
    for name, _ in available(PLANS):
        path = find(PLANS, name)
        header = header_of(path, path.stat().st_mtime_ns)
        if role == "engineer" or header.get("released") is True:
            rows.append({"name": name, "title": words(header.get("title"))})
    return rows


@lru_cache(maxsize=200)
def header_of(plan: Path, changed_ns: int) -> Mapping[str, Any]:
    """Return what a plan says, with what it extends; nothing where it cannot be read."""
    try:
        return dict(merged(layers_of(read_yaml(plan))).data)
    except (StationError, OSError):
        return {}


def counts(entries: Sequence[Mapping[str, Any]], plan: str) -> dict[str, Any]:
    """Return how many runs began today and passed, and how a plan's runs ended of late.

    A run whose verdict its folder does not vouch for counts as a run alone.
    """
    today = local_time().date()
    begun = [entry["verdict"] for entry in entries if local_day(entry["started"]) == today]
    of_plan = [entry["verdict"] for entry in entries if entry["plan"] == plan]
    decided = [verdict for verdict in of_plan if verdict in ("pass", "fail")]
    return {
        "runs": len(begun),
        "passed": begun.count("pass"),
        "plan": {"plan": plan, "decided": len(decided), "passed": decided.count("pass")},
    }


def local_day(utc: str) -> date | None:
    """Return the day, where the bench stands, of a time in UTC; None where the text is none."""
    try:
        return datetime.fromisoformat(utc).astimezone().date()
    except (ValueError, OverflowError):
        return None


def device(runs: Path, serial: str) -> dict[str, Any]:
    """Return how the results of a device went from run to run, oldest first.

    Only what a folder vouches for counts.
    """
    entries = [entry for entry in newest_runs(runs, serial) if entry["serial"] == serial]
    evaluated = [entry["run"] for entry in reversed(entries) if entry["verdict"]]
    trends: dict[tuple[str, str, str], dict[str, Any]] = {}
    for run in evaluated:
        for result in read_json(runs / run / RESULTS).get("results", ()):
            if result.get("value") is None:
                continue
            name, axis, unit = result["name"], result.get("axis") or "", result["unit"]
            trend = trends.setdefault(
                (name, axis, unit),
                {"name": name, "axis": axis, "unit": unit, "values": [], "u": []},
            )
            trend["values"].append(result["value"])
            trend["u"].append(result.get("expanded_uncertainty"))
    return {"runs": len(evaluated), "results": list(trends.values())}
