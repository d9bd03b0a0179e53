"""Short runs of the temperature procedure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from plan_runs import run_of, shipped_bench, shipped_plan

from station.runner.outcome import Outcome

PROCEDURE = "fog-scale-factor-temperature"


SHORT: dict[str, Any] = {
    "outside_published_range": True,
    "temperature_range": ["20 degC", "30 degC"],
    "reference_temperature": "26 degC",
    "soak": "10 min",
    "random_rotation": "20 s",
    "verification": None,
    "asked_uncertainty": None,
    "warm_up": {"slope_limit": "6 degC/h", "window": "10 min", "at_most": "4 h"},
}


def short_run(
    folder: Path, seed: int, *faults: dict[str, str], bench_name: str = "sim", **changes: Any
) -> tuple[Outcome, dict[str, Any]]:
    """Run a ramp over ten degrees; return the truth of the gyros beside it."""
    plan = shipped_plan(PROCEDURE)
    bench = shipped_bench(bench_name)
    plan["parameters"] |= SHORT | changes
    plan["limits"] = {"scale_factor_error": {"max_abs": "500 ppm"}}
    bench["simulation"] |= {"seed": seed, "faults": list(faults)}
    outcome = run_of(folder, plan, bench)
    truth: dict[str, Any] = bench["simulation"]["fog"]["gyros"]
    return outcome, truth
