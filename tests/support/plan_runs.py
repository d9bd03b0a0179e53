"""Runs of plans that a test makes of the shipped ones, on the simulated bench, in-process."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from quick_yaml import dump_yaml, load_yaml

from station import registry
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.runner.execute import Request, execute
from station.runner.outcome import Outcome


def shipped_plan(procedure: str) -> dict[str, Any]:
    """Return the shipped plan of a procedure as data."""
    data: dict[str, Any] = load_yaml(find(PLANS, procedure).read_text(encoding="utf-8"))
    return data


def shipped_bench(name: str = "sim") -> dict[str, Any]:
    """Return a shipped bench as data."""
    data: dict[str, Any] = load_yaml(find(BENCHES, name).read_text(encoding="utf-8"))
    return data


def run_of(
    folder: Path,
    plan: dict[str, Any],
    bench: dict[str, Any],
    served: Mapping[str, Any] | None = None,
) -> Outcome:
    """Run a plan on a bench, both as data, without a report; the run lies below `folder`/runs."""
    folder.mkdir(exist_ok=True)
    plan_path, bench_path = folder / "plan.yaml", folder / "bench.yaml"
    plan_path.write_text(dump_yaml(plan), encoding="utf-8")
    bench_path.write_text(dump_yaml(bench), encoding="utf-8")
    return execute(
        Request(
            read_plan(plan_path, Procedures()),
            read_bench(bench_path, registry.names(registry.DRIVERS)),
            folder / "runs",
            quiet=True,
            report=False,
            served=served,
        )
    )
