"""One run of many, evaluated again from its folder alone, in a process that may be elsewhere."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from station.errors import StationError, reason_of
from station.reanalysis.recall import Recall
from station.record.folder import RESULTS, RunFolder
from station.record.stores import is_url, run_at_hand
from station.recorded import read_plan_and_bench, used_instruments
from station.results import ResultDocument
from station.runner.evaluation import evaluate_run, text_of

Row = dict[str, Any]


def rows_of_run(path: str, recall: Recall | None = None) -> list[Row]:
    """Return a row for each result of a run, beside what its folder stores; units as in the result.

    Of a run that a URL names a copy is evaluated, in a temporary folder. With a `recall` only of a
    run that used the recalled certificate, with the new record in its place. A run that cannot be
    evaluated has one row that says why.
    """
    about: Row = {"run": path.rpartition("/")[2] if is_url(path) else Path(path).name}
    about["folder"] = path
    try:
        with run_at_hand(path) as folder:
            return _rows(RunFolder(folder), recall, about)
    except (StationError, OSError, ValueError, LookupError, TypeError) as error:
        return [{**about, "error": reason_of(error)}]


def _rows(folder: RunFolder, recall: Recall | None, about: Row) -> list[Row]:
    facts = folder.run_facts()
    plan, bench = read_plan_and_bench(folder)
    about |= {
        "procedure": plan.procedure,
        "model": plan.dut.model,
        "serial": plan.dut.serial,
        "started_utc": facts["started_utc"],
        "bench": bench.name,
    }
    if recall is not None:
        began = dt.date.fromisoformat(facts["started_utc"][:10])
        recalled = recall.concerned(bench, used_instruments(folder), began)
        if not recalled:
            return []
        about["recalled"] = ", ".join(recalled)
    document, _ = evaluate_run(folder, recall.applied if recall else None)
    about |= {
        "verdict": document.verdict,
        "flags": ", ".join(dict.fromkeys(flag.code for flag in document.flags)),
        "results_sha256": hashlib.sha256(text_of(document).encode()).hexdigest(),
    }
    return [{**about, **row} for row in _results(document, _stored(folder))]


def certificates_of(path: str) -> set[str]:
    """Return the certificates of the instruments that a run used; none where it does not say.

    Raises StationError where the run itself cannot be read.
    """
    try:
        with run_at_hand(path, raw=False) as place:
            folder = RunFolder(place)
            bench = read_plan_and_bench(folder)[1]
            records = [bench.record(name) for name in used_instruments(folder)]
    except (OSError, ValueError, LookupError, TypeError):
        return set()
    return {record.certificate for record in records if record and record.certificate}


def _results(document: ResultDocument, stored: Mapping[str, Any]) -> Iterator[Row]:
    before = {(entry["name"], entry["axis"]): entry for entry in stored.get("results", ())}
    for entry in document.to_data()["results"]:
        earlier = before.get((entry["name"], entry["axis"]), {})
        u, value, old = entry["standard_uncertainty"], entry["value"], earlier.get("value")
        change = value - old if value is not None and old is not None else None
        yield {
            "stored_verdict": stored.get("verdict"),
            "name": entry["name"],
            "axis": entry["axis"],
            "value": value,
            "unit": entry["unit"],
            "standard_uncertainty": u,
            "expanded_uncertainty": entry["expanded_uncertainty"],
            "method": entry["method"],
            "result_verdict": entry["verdict"],
            "stored_value": old,
            "stored_expanded_uncertainty": earlier.get("expanded_uncertainty"),
            "change_in_u": change / u if change is not None and u else None,
        }


def _stored(folder: RunFolder) -> Mapping[str, Any]:
    """Return the results that a folder stores; none where it has none that are the run's own."""
    if folder.damage.against(RESULTS):
        return {}
    try:
        stored: Mapping[str, Any] = json.loads((folder.path / RESULTS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return stored
