"""Runs with a fault."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rlg_runs import short_run

from station.runner.outcome import Outcome

ONE_AXIS = {"parameters/axes": ["NA"], "parameters/duration": "100 s"}


NOTHING_LEFT_A = 0.001


Entry = dict[str, Any]


def run_with(folder: Path, *entries: Entry) -> tuple[Outcome, dict[str, Any]]:
    """Run one axis with faults; return how it ended and the end state of the world."""
    report = folder / "world.json"
    outcome, _ = short_run(
        folder,
        plan=ONE_AXIS,
        bench={"simulation/faults": list(entries), "simulation/report": str(report)},
    )
    return outcome, json.loads(report.read_text(encoding="utf-8"))


def is_safe(world: dict[str, Any]) -> bool:
    """Whether no supply is on and none drives a coil."""
    driven = [abs(coil["driven_A"]) for coil in world["coils"].values()]
    return not any(world["outputs"].values()) and max(driven) < NOTHING_LEFT_A
