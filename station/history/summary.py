"""What the history keeps of a run folder; the folder stays the truth."""

from __future__ import annotations

import hashlib
import json
import re
import socket
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from sqlalchemy import Table

from station.errors import InputError
from station.history.tables import INSTRUMENTS, RUNS
from station.history.tables import RESULTS as RESULT_TABLE
from station.record.files import is_own_file
from station.record.folder import RESULTS
from station.record.layout import BENCH, EVENTS, MANIFEST, PLAN, RUN, file_hash
from station.record.verification import quick_look

IDENTIFIED = b'"event": "identified"'
RESUMED = b'"event": "resumed"'
RUN_STARTED = "run-started"
SIMULATION = re.compile(r"^(simulation|\s+simulator):(?!\snull)", re.MULTILINE)
QUICK = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""A resolved plan was read and written by the station: nobody asks for the place of its keys."""
Row = Mapping[str, Any]
DAMAGE = (
    OSError,
    ValueError,
    LookupError,
    OverflowError,
    TypeError,
    AttributeError,
    RecursionError,
    yaml.YAMLError,
)


@dataclass(frozen=True)
class RunSummary:
    """A run as the tables hold it: its own row, and those of its results and its instruments.

    `at` is the folder it was read from, which may be a copy for the moment.
    """

    at: Path
    run: Row
    results: tuple[Row, ...]
    instruments: tuple[Row, ...]


def summary_of(folder: Path, url: str | None = None) -> RunSummary:
    """Return what the history keeps of a run; with `url` the folder is a copy of the one there.

    Raises InputError where it cannot be read, or a quick look shows that it was altered.
    """
    try:
        state = quick_look(folder)
        if state.state == "altered":
            raise InputError(f"{folder} is not taken into the history: {state.sentence()}")
        return _summary(folder, url)
    except DAMAGE as error:
        raise InputError(
            f"{folder} cannot be taken into the history ({error}); `station verify` says what is "
            "damaged"
        ) from error


def _summary(folder: Path, url: str | None) -> RunSummary:
    for name in (EVENTS, RUN, PLAN, BENCH):
        if not is_own_file(folder / name):
            raise ValueError(f"{name} is missing, or is no plain file")
    log = (folder / EVENTS).read_bytes().splitlines()
    whole = log if _is_json(log[-1]) else log[:-1]  # the last line of a killed run may be cut
    begun, facts = json.loads(whole[0]), _json(folder / RUN)
    if begun["event"] != RUN_STARTED:
        raise ValueError(f"{EVENTS} does not begin with {RUN_STARTED}")
    plan = yaml.load((folder / PLAN).read_text(encoding="utf-8"), QUICK)
    document = _json(folder / RESULTS) if is_own_file(folder / RESULTS) else {}
    run = {
        "key": _key(whole, facts),
        "host": facts["host"],
        "run": folder.name,
        "computer": socket.gethostname() if url is None else "/".join(url.split("/")[:3]),
        "folder": str(folder.resolve()) if url is None else url,
        "started_utc": facts["started_utc"],
        "ended_utc": facts.get("ended_utc"),
        "procedure": begun["procedure"],
        "model": begun["dut"]["model"],
        "serial": begun["dut"]["serial"],
        "operator": plan.get("operator"),
        "bench": Path(facts["bench_file"]).stem,
        "simulated": bool(SIMULATION.search((folder / BENCH).read_text(encoding="utf-8"))),
        "check_standard": bool(plan.get("check_standard")),
        "state": "evaluated" if document else "without results",
        "verdict": document.get("verdict"),
        "head": manifest_head(folder),
    }
    return RunSummary(
        folder,
        _as_kept(run, RUNS),
        tuple(_as_kept(row, RESULT_TABLE) for row in _results(document)),
        tuple(_as_kept(row, INSTRUMENTS) for row in _instruments(whole)),
    )


def _as_kept(row: Row, table: Table) -> Row:
    """Return a row as its table holds it; raises ValueError or TypeError where none could."""
    kept = dict[str, Any]()
    for name, value in row.items():
        column = table.c[name]
        wanted = column.type.python_type
        if wanted is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not (isinstance(value, wanted) or (value is None and column.nullable)):
            raise TypeError(f"{name} is {value!r}")
        # PostgreSQL keeps no NUL in a text, SQLite no NaN, and neither half a character.
        if value != value or b"\0" in str(value).encode():
            raise ValueError(f"{name} is {value!r}")
        kept[name] = value
    return kept


def key_of(folder: Path) -> str:
    """Return the key of a run, the same for each copy of its folder; may raise what DAMAGE names.

    It is the SHA-256 of the line of its log with which its last process began, which holds by the
    chain for all before it, and of when and where the run began: two runs of one plan on a
    simulated bench begin alike. Of a folder that was copied, and of which both were resumed, two
    runs have come.
    """
    if not (is_own_file(folder / EVENTS) and is_own_file(folder / RUN)):
        raise ValueError(f"{EVENTS} or {RUN} is missing, or is no plain file")
    with (folder / EVENTS).open("rb") as log:
        return _key((line.removesuffix(b"\n") for line in log), _json(folder / RUN))


def _key(log: Iterable[bytes], facts: Row) -> str:
    first, *others = (line for n, line in enumerate(log) if not n or RESUMED in line)
    began = f"{facts['started_utc']} {facts['host']}"
    return hashlib.sha256((others or [first])[-1] + b"\n" + began.encode()).hexdigest()


def manifest_head(folder: Path) -> str:
    """Return the SHA-256 of a run's manifest; that of the log of a run that was killed."""
    manifest = folder / MANIFEST
    return file_hash(manifest if manifest.is_file() else folder / EVENTS)


def _results(document: Row) -> Iterator[Row]:
    for entry in document.get("results", ()):
        low, high = _interval(entry.get("limit") or {})
        yield {
            "name": entry["name"],
            "axis": entry["axis"],
            "value": entry["value"],
            "unit": entry["unit"],
            "standard_uncertainty": entry["standard_uncertainty"],
            "expanded_uncertainty": entry["expanded_uncertainty"],
            "limit_min": low,
            "limit_max": high,
            "verdict": entry["verdict"],
        }


def _interval(limit: Row) -> tuple[float | None, float | None]:
    """Return the lowest and the highest value within a limit as `results.json` has it."""
    if "max_abs" in limit:
        return -limit["max_abs"], limit["max_abs"]
    return limit.get("min"), limit.get("max")


def _instruments(log: list[bytes]) -> Iterator[Row]:
    """Yield each instrument that the run identified, once."""
    seen = {}
    for line in log:
        if IDENTIFIED in line:
            event = json.loads(line)
            seen[event["instrument"]] = event
    for name, event in seen.items():
        yield {"instrument": name, "model": event["model"], "serial": event["serial"] or ""}


def _json(path: Path) -> dict[str, Any]:
    data = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(data, dict):
        raise TypeError(f"{path.name} holds no mapping")
    return data


def _is_json(line: bytes) -> bool:
    try:
        json.loads(line)
    except ValueError:
        return False
    return True
