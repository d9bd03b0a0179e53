"""`station list` and `station status`: what there is, and how it stands."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

from station import registry
from station.console import span, tell
from station.control.status import Status, newest_run, read_status
from station.errors import InputError
from station.files.lookup import BENCHES, PLANS, available
from station.procedure import procedure_of
from station.record.events import whole_bench
from station.record.run_list import newest_runs
from station.record.run_names import RUNS
from station.record.run_state import SENTENCES
from station.record.verification import quick_look
from station.speech import folded, padded, said, show


def list_what_there_is(kind: str | None, *, search: str = "", as_json: bool) -> None:
    """Print the names of one kind, or of all kinds, with a line about each.

    `search` leaves the runs of which name, serial number, operator, verdict or state hold it.
    """
    from station.roles.role import collected

    kinds = [kind] if kind else ["procedures", "plans", "benches", "drivers", "runs"]
    tables = {what: entries(what, search) for what in kinds}
    for sentence in (*registry.offers()[1], *collected()[1]):
        tell(f"WARNING: {sentence}")
    if as_json:
        print(json.dumps(tables, indent=1, ensure_ascii=False))
        return
    for what, rows in tables.items():
        show(f"{what}:")
        width = max((len(row["name"]) for row in rows), default=0)
        for row in rows:
            print(f"  {row['name']:<{width}}  {said(row['about'])}".rstrip())
        if not rows:
            show("  none")


def entries(kind: str, search: str = "") -> list[dict[str, Any]]:
    """Return name and a line about each thing of a kind."""
    if kind == "procedures":
        return [
            {"name": name, "about": about(name)} for name in registry.names(registry.PROCEDURES)
        ]
    if kind == "plans":
        return [{"name": name, "about": where} for name, where in available(PLANS)]
    if kind == "benches":
        return [{"name": name, "about": where} for name, where in available(BENCHES)]
    if kind == "drivers":
        simulated = dict.fromkeys(registry.names(registry.SIMULATORS), "with a simulator")
        return [
            {
                "name": name,
                "about": registry.why_not(registry.DRIVERS, name) or simulated.get(name, ""),
            }
            for name in registry.names(registry.DRIVERS)
        ]
    return [listed_run(run) for run in newest_runs(RUNS, search)]


def about(procedure: str) -> str:
    """Return the title of a procedure, or why it cannot be loaded."""
    try:
        return procedure_of(procedure).title
    except InputError as error:
        return str(error)


def listed_run(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is listed of a run: how it stands, when it began, and who ran it."""
    verdict = entry["verdict"]
    stands = f"verdict {verdict}" if verdict and not entry["running"] else entry["state"]
    parts = (stands, entry["started"][:16].replace("T", " "), entry["operator"])
    return {"name": entry["run"], "about": "  ".join(filter(None, parts)), **entry}


MAX_UNITS = 6
NAMES, LEAST_COLUMNS = 16, 20
"""Columns of a terminal for names, and at least for what is said beside them."""


def print_status(run: Path | None, *, as_json: bool) -> None:
    """Print how a run stands; without one, the newest below `runs`."""
    folder = newest_run(RUNS) if run is None else run
    status, record = read_status(folder), quick_look(folder)
    if as_json:
        kept = {"state": record.state, "depth": record.depth, "changed": list(record.changed)}
        print(json.dumps({**status.to_data(), "record": kept}, indent=1, ensure_ascii=False))
        return
    table = rows(status)
    if not record.going_on:
        table.append(("record", record.sentence()))
    columns = get_terminal_size().columns if sys.stdout.isatty() else None
    for name, text in table:
        shown = said(text)
        if columns is not None:
            shown = folded(shown, max(columns - NAMES, LEAST_COLUMNS), NAMES)
        print(f"{padded(name, NAMES)}{shown}")


def rows(status: Status) -> list[tuple[str, str]]:
    """Return what there is to say, a name and a text each."""
    dut = status.dut
    done = len(status.units_finished)
    of = "" if status.units_planned is None else f" of {status.units_planned}"
    shown = ", ".join(status.units_finished[-MAX_UNITS:])
    listed = f" ({'… ' if done > MAX_UNITS else ''}{shown})" if done else ""
    table = [
        ("run", status.run),
        ("procedure", status.procedure or "unknown"),
        ("device", f"{dut['model']} {dut['serial']}" if dut else "unknown"),
        ("state", SENTENCES[status.state]),
        ("step", f"{status.step}  {status.step_title}" if status.step else "none yet"),
        ("units of work", f"{done}{of} finished{listed}"),
        ("run time", span(status.run_time_s)),
    ]
    if status.state in ("running", "paused") and status.remaining_s is not None:
        table.append(("bench time left", f"about {span(status.remaining_s)}"))
    if status.bench_safe is not None:
        whole = whole_bench(status.left_out).removeprefix("the bench is ")
        table.append(("bench", whole if status.bench_safe else "NOT VERIFIED as safe"))
    elif status.state == "interrupted":
        table.append(("bench", "NOT made safe by the run itself; look at it now"))
    table.append(("last message", status.message))
    return table
