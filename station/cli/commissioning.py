"""`station commission`: the commissioning plan, fitted to a bench."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from station.cli.running import run_plan
from station.cli.validating import read_bench_named
from station.procedure import procedure_of

PLAN = "commissioning"


def commission_bench(
    bench_name: str,
    overrides: Sequence[str],
    non_interactive: bool,
    answers: Path | None,
    output: Path,
    *,
    as_json: bool,
) -> int:
    """Run the shipped plan on a bench and return the exit code of the run.

    The plan is fitted to the bench, as far as an override does not state otherwise.
    """
    stated = {one.partition("=")[0] for one in overrides}
    fitted = [
        one
        for one in procedure_of(PLAN).fits(read_bench_named(bench_name))
        if one.partition("=")[0] not in stated
    ]
    return run_plan(
        PLAN,
        bench_name,
        non_interactive=non_interactive,
        answers=answers,
        served=None,
        output=output,
        as_json=as_json,
        overrides=(*fitted, *overrides),
    )
