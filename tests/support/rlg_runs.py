"""Short laser-gyro runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from plan_runs import run_of, shipped_bench, shipped_plan

from station.runner.outcome import Outcome

PROCEDURE = "rlg-magnetic-sensitivity"


Changes = dict[str, Any]


def changed(data: Any, changes: Changes) -> Any:
    """Return YAML data with values replaced by dotted path."""
    for path, value in changes.items():
        *way, last = path.split("/")
        place = data
        for part in way:
            place = place[part]
        place[last] = value
    return data


def short_run(
    folder: Path, plan: Changes | None = None, bench: Changes | None = None
) -> tuple[Outcome, dict[str, Any]]:
    """Run the shipped plan with a short warm-up and record, no report; return truth beside it."""
    plan_data = shipped_plan(PROCEDURE)
    bench_data = shipped_bench()
    plan_data["parameters"]["duration"] = "200 s"
    plan_data["parameters"]["warm_up"] = {
        "slope_limit": "10 deg/h^2",
        "window": "1 min",
        "at_most": "5 min",
    }
    changed(plan_data, plan or {})
    changed(bench_data, bench or {})
    outcome = run_of(folder, plan_data, bench_data)
    truth = bench_data["simulation"]["gyro"]["magnetic_sensitivity"]
    return outcome, {axis: float(text.split()[0]) for axis, text in truth.items()}
