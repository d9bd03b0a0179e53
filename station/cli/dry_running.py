"""`station run --dry-run`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from station.cli.running import read_served
from station.cli.validating import read_bench_named, read_plan_for
from station.console import span
from station.errors import EXIT_DONE
from station.procedure import procedure_of
from station.runner.disk_space import in_bytes
from station.runner.dry_run import DryRun, Extreme, walk

if TYPE_CHECKING:
    from station.files.plan import Plan
    from station.instruments.bench import Bench


def dry_run_plan(
    plan_name: str,
    bench_name: str,
    *,
    served: Path | None,
    output: Path,
    as_json: bool,
    overrides: Sequence[str] = (),
) -> int:
    """Print what a run of the plan would do, and return the exit code."""
    bench = read_bench_named(bench_name)
    plan = read_plan_for(plan_name, bench, overrides)
    walked = walk(plan, bench, output, read_served(served) if served else None)
    if as_json:
        head = {"procedure": plan.procedure, "dut": vars_of_dut(plan), "bench": bench.name}
        document = {"dry_run": True, **head, **walked.to_data()}
        print(json.dumps(document, indent=1, ensure_ascii=False))
    else:
        for line in lines(walked, plan, bench):
            print(line)
    for warning in walked.warnings:
        print(f"WARNING: {warning}", file=sys.stderr)
    return EXIT_DONE


def vars_of_dut(plan: Plan) -> dict[str, str]:
    """Return model and serial number of the device under test."""
    return {"model": plan.dut.model, "serial": plan.dut.serial}


def lines(walked: DryRun, plan: Plan, bench: Bench) -> Iterator[str]:
    """Yield the walk as a table of steps and set-points, and what it comes to."""
    title = procedure_of(plan.procedure).title
    yield f"{title}: {plan.dut.model} {plan.dut.serial}, bench {bench.name}"
    yield "step   begins at    takes"
    for one in walked.steps:
        when = f"{span(one.starts_s):<12} {span(one.expected_s):<12}"
        yield f"{one.step:<6} {when} {one.title}"
        for point in one.set_points:
            yield f"{'':<33}{point.instrument}: {point.text}"
    yield ""
    for extreme in walked.extremes:
        yield row(f"{extreme.which} {extreme.quantity}", in_words(extreme))
    yield row("expected duration", f"{span(walked.expected_s)} of bench time")
    yield row("estimated end", estimated_end(walked))
    disk = walked.disk
    needed, free = in_bytes(disk.needed_bytes), in_bytes(disk.free_bytes)
    yield row("disk space needed", f"about {needed}, free below {disk.folder}: {free}")
    memory = walked.memory
    fitted = (
        ""
        if memory.fitted_bytes is None
        else f", this computer has {in_bytes(memory.fitted_bytes)}"
    )
    yield row("memory needed", f"about {in_bytes(memory.needed_bytes)} to evaluate{fitted}")
    yield "dry run: no instrument was opened and nothing was written"


def row(name: str, text: str) -> str:
    """Return one line of the summary."""
    return f"{name:<21}{text}"


def in_words(extreme: Extreme) -> str:
    """Return an extreme as text: `3.33 A (coil_supply.x)`."""
    if extreme.value is None:
        return f"{extreme.note} ({extreme.instrument})"
    note = f", {extreme.note}" if extreme.note else ""
    return f"{extreme.value:.4g} {extreme.unit} ({extreme.instrument}{note})"


def estimated_end(walked: DryRun) -> str:
    """Return when a run that begins now would end, or why that is not told."""
    if walked.speed is None:
        return "unknown: a simulated bench runs on virtual time, where waiting is skipped"
    if walked.ends_utc is None:
        return "beyond all calendars"
    faster = "" if walked.speed == 1.0 else f", at {walked.speed:g} times real time"
    return f"{walked.ends_utc:%Y-%m-%d %H:%M} UTC if it begins now{faster}"
