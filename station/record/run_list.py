"""The runs below a folder, a line about each, read with care."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from station.errors import InputError
from station.record.careful_reading import first_line, own_text, read_json, words
from station.record.layout import EVENTS, PLAN, RUN
from station.record.run_names import runs_below, serial_of
from station.record.verification import quick_look

RESULTS = "results.json"
OPERATOR = re.compile(r"^operator: (?!null\b)(.*?) *(?:#.*)?$", re.MULTILINE)


def newest_runs(runs: Path, search: str = "", most: int | None = None) -> list[dict[str, Any]]:
    """Return the newest runs, at most so many; those alone of which a word holds the text."""
    rows: list[dict[str, Any]] = []
    for folder in reversed(runs_below(runs)):
        if most is not None and len(rows) >= most:
            break
        if not folder.name.isprintable():  # nothing can be had of it
            continue
        entry = entry_of(folder)
        named = (entry[key] for key in ("run", "serial", "operator", "verdict", "state"))
        if search.lower() in " ".join(filter(None, named)).lower():
            rows.append(entry)
    return rows


def entry_of(folder: Path) -> dict[str, Any]:
    """Return how a run stands, by a quick look; a verdict that it does not vouch for is none."""
    begun = first_event(folder)
    facts = read_json(folder / RUN)
    verdict = words(read_json(folder / RESULTS).get("verdict")) or None
    try:
        looked = quick_look(folder)
        running = looked.going_on
        state = "running" if running else "evaluated" if verdict else "ended without results"
        if looked.state == "altered" or (verdict and looked.unproven):
            verdict, state = None, looked.sentence()
    except (OSError, InputError) as error:
        running, verdict, state = False, None, str(error)
    return {
        "run": folder.name,
        "procedure": words(begun.get("procedure")),
        "bench": words(facts.get("bench_file")),
        "serial": serial_of(folder),
        "operator": operator_of(folder),
        "started": words(facts.get("started_utc")),
        "running": running,
        "verdict": verdict,
        "state": state,
    }


def operator_of(folder: Path) -> str:
    """Return who the plan says runs it, as its resolved copy has it."""
    match = OPERATOR.search(own_text(folder / PLAN))
    return words(match[1].strip("'\"")) if match else ""


def first_event(folder: Path) -> dict[str, Any]:
    """Return the first event of a run, nothing where it cannot be read."""
    return first_line(folder / EVENTS)
