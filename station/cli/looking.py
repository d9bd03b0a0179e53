"""`station list` and `station status`: what there is, and how it stands."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

from station import registry
from station.console import span, tell
from station.control.status import Status, newest_run, read_status
from station.errors import InputError
from station.files.lookup import BENCHES, PLANS, available
from station.history.place import DATABASE
from station.procedure import procedure_of
from station.record.certificates import KEPT, register
from station.record.events import whole_bench
from station.record.run_list import newest_runs
from station.record.run_names import RUNS
from station.record.run_state import SENTENCES
from station.record.verification import quick_look
from station.speech import folded, padded, said, show

RUNS_ON_A_PAGE = 50


def list_what_there_is(
    kind: str | None, *, search: str = "", store: str = str(RUNS), page: int = 1, as_json: bool
) -> None:
    """Print the names of one kind, or of all kinds, with a line about each.

    Of the runs of a store, a page, newest first; `search` leaves those of which name, serial
    number, operator, verdict or state hold it.
    """
    from station.roles.role import collected

    kinds = [kind] if kind else ["procedures", "plans", "benches", "drivers", "runs"]
    tables = {what: entries(what, search, store, page) for what in kinds}
    older = len(tables.get("runs", ())) > RUNS_ON_A_PAGE
    if "runs" in tables:
        tables["runs"] = tables["runs"][:RUNS_ON_A_PAGE]
    for sentence in (*registry.offers()[1], *collected()[1]):
        tell(f"WARNING: {sentence}")
    if as_json:
        paged = {"page": page, "older": older} if "runs" in tables else {}
        print(json.dumps({**tables, **paged}, indent=1, ensure_ascii=False))
        return
    for what, rows in tables.items():
        show(f"{what}:")
        width = max((len(row["name"]) for row in rows), default=0)
        for row in rows:
            print(f"  {row['name']:<{width}}  {said(row['about'])}".rstrip())
        if not rows:
            show("  none")
    if older:
        show(f"older runs: --page {page + 1}")


def entries(
    kind: str, search: str = "", store: str = str(RUNS), page: int = 1
) -> list[dict[str, Any]]:
    """Return name and a line about each thing of a kind; of runs a page, and the next one."""
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
    wanted = search, RUNS_ON_A_PAGE + 1, RUNS_ON_A_PAGE * (page - 1)
    if DATABASE.match(store) and kind == "runs":
        return [listed_run(run) for run in runs_taken_in(store, *wanted)]
    if store != str(RUNS) and not Path(store).is_dir():
        raise InputError(
            f"there is no folder {store}; name one with run folders, or the URL of a history"
        )
    if kind == "certificates":
        return [listed_certificate(issue) for issue in register(Path(store))]
    return [listed_run(run) for run in newest_runs(Path(store), *wanted)]


def runs_taken_in(url: str, search: str, most: int, skip: int) -> list[dict[str, Any]]:
    """Return the runs of a history, each with what `list runs` says of a folder."""
    from station.history.store import History

    with closing(History(RUNS, url)) as history:
        return [{**row, "running": False} for row in history.runs(search, most, skip)]


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


def listed_certificate(issue: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is listed of a certificate: when, of what, for whom, and what replaces what."""
    links = (
        ("replaces", issue["replaces"]),
        ("replaced by", issue["replaced_by"]),
    )
    joined = (f"{words} {text}" for words, text in links if text)
    wrong = "" if issue["state"] == KEPT else f"PDF {issue['state'].upper()}"
    parts = (issue["date"], issue["device"], issue["customer"], *joined, wrong)
    return {"name": issue["number"], "about": "  ".join(filter(None, parts)), **issue}


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
