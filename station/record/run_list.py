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
SEARCHED = ("run", "serial", "operator", "verdict", "state")
"""The words of a run that are searched, here and in a history."""
PLAN_FILE = re.compile(r"# (.+?), resolved$", re.MULTILINE)


def newest_runs(
    runs: Path, search: str = "", most: int | None = None, skip: int = 0
) -> list[dict[str, Any]]:
    """Return the newest runs but the first few, at most so many.

    Those alone of which a word holds the text.
    """
    rows: list[dict[str, Any]] = []
    for folder in reversed(runs_below(runs)):
        if most is not None and len(rows) >= most:
            break
        if not folder.name.isprintable():  # nothing can be had of it
            continue
        if skip and not search:  # it need not be read
            skip -= 1
            continue
        entry = entry_of(folder)
        if any(search.lower() in (entry[key] or "").lower() for key in SEARCHED):
            if skip:
                skip -= 1
            else:
                rows.append(entry)
    return rows


def entry_of(folder: Path) -> dict[str, Any]:
    """Return how a run stands, by a quick look; a verdict that it does not vouch for is none."""
    begun, plan = first_event(folder), own_text(folder / PLAN)
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
        "operator": operator_of(plan),
        "plan": plan_of(plan),
        "started": words(facts.get("started_utc")),
        "running": running,
        "verdict": verdict,
        "state": state,
    }


def again(folder: Path) -> dict[str, str]:
    """Return what starts the same plan once more: the names of plan and bench, the operator."""
    plan, facts = own_text(folder / PLAN), read_json(folder / RUN)
    bench = Path(words(facts.get("bench_file"))).stem
    return {"plan": plan_of(plan), "bench": bench, "operator": operator_of(plan)}


def operator_of(plan: str) -> str:
    """Return who runs it by the text of a resolved plan."""
    return written(plan, "operator")


def title_of(folder: Path) -> str:
    """Return the title of a run's plan, empty where it has none."""
    return written(own_text(folder / PLAN), "title")


def written(plan: str, key: str) -> str:
    """Return what a line of a resolved plan says, empty where it says nothing."""
    match = re.search(rf"^{key}: (.*)$", plan, re.MULTILINE)
    text = match[1].partition(" #")[0].strip() if match else "null"
    if match and text[:1] in ("'", '"'):
        import yaml

        try:
            return words(yaml.safe_load(match[1]))
        except yaml.YAMLError:
            return ""
    return "" if text == "null" else words(text)


def plan_of(plan: str) -> str:
    """Return the name of the plan by the text of a resolved one."""
    match = PLAN_FILE.match(plan)
    return words(Path(match[1]).stem) if match else ""


def first_event(folder: Path) -> dict[str, Any]:
    """Return the first event of a run, nothing where it cannot be read."""
    return first_line(folder / EVENTS)
