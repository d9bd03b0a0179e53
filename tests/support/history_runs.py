"""Run folders with what the history reads of them, and no raw data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from station.record.events import FIRST_HASH
from station.record.layout import write_manifest


def made_run(
    parent: Path,
    day: int,
    value: float | None,
    *,
    serial: str = "SN-1",
    bench: str = "sim",
    standard: bool = False,
    u: float = 0.1,
    limit: float | None = 5.0,
    sealed: bool = True,
) -> Path:
    """Make the folder of a run of day number `day` that found one result; return it."""
    date = f"2026-{1 + day // 28:02d}-{1 + day % 28:02d}"
    folder = parent / f"{date.replace('-', '')}T080000Z-coil-constant-{serial}"
    folder.mkdir(parents=True)
    dut = {"model": "C-3", "serial": serial}
    begun = {"t_s": 0.0, "event": "run-started", "procedure": "coil-constant", "dut": dut}
    seen = {
        "t_s": 0.0,
        "event": "identified",
        "instrument": "gaussmeter",
        "model": "F71",
        "serial": "L1",
    }
    events = [begun, seen, {"t_s": 0.0, "event": "run-ended", "complete": True}]
    texts = {
        "events.jsonl": chained(events),
        "plan.resolved.yaml": f"operator: Mei  # plan.yaml:3\ncheck_standard: {standard}\n".lower(),
        "bench.resolved.yaml": "name: sim\nsimulation:\n  seed: 1\n",
        "run.json": _json(
            {
                "started_utc": f"{date}T08:00:00+00:00",
                "ended_utc": f"{date}T09:00:00+00:00",
                "host": "lab",
                "bench_file": f"/benches/{bench}.yaml",
            }
        ),
        "results.json": _json(_document(value, u, limit)),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    if sealed:
        write_manifest(folder)
    return folder


def chained(events: Sequence[dict[str, Any]]) -> str:
    """Return the text of a log, each line with the SHA-256 of the one before."""
    lines, previous = list[str](), FIRST_HASH
    for event in events:
        lines.append(json.dumps({**event, "previous": previous}))
        previous = hashlib.sha256(lines[-1].encode()).hexdigest()
    return "".join(f"{line}\n" for line in lines)


def _document(value: float | None, u: float, limit: float | None) -> dict[str, Any]:
    entry = {
        "name": "coil_constant",
        "axis": "x",
        "value": value,
        "unit": "mT/A",
        "standard_uncertainty": None if value is None else u,
        "expanded_uncertainty": None if value is None else 2 * u,
        "limit": None if limit is None else {"max_abs": limit},
        "verdict": "pass" if limit else "none",
    }
    return {"verdict": entry["verdict"], "results": [entry]}


def _json(data: object) -> str:
    return json.dumps(data, indent=1)
