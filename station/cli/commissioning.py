"""`station commission`: the commissioning plan, fitted to a bench, and its weekly check."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from station.cli.running import report_outcome, request_of
from station.cli.validating import read_bench_named
from station.errors import EXIT_DONE, EXIT_FAULT, EXIT_UNDETERMINED
from station.findings import NOT_TRIED
from station.procedure import procedure_of
from station.runner.execute import execute

PLAN = "commissioning"


def commission_bench(
    bench_name: str,
    overrides: Sequence[str],
    non_interactive: bool,
    answers: Path | None,
    output: Path,
    *,
    check: bool,
    as_json: bool,
    trace: bool = False,
) -> int:
    """Run the shipped plan on a bench, or its short form, and return the exit code of the run.

    The plan is fitted to the bench, as far as an override does not state otherwise.
    """
    bench = read_bench_named(bench_name)
    stated = {
        key.strip(): text for key, _, text in (override.partition("=") for override in overrides)
    }
    fits = procedure_of(PLAN).fits(bench, check, stated)
    fitted = [fit for fit in fits if fit.partition("=")[0] not in stated]
    request = request_of(
        PLAN,
        bench_name,
        non_interactive=non_interactive,
        answers=answers,
        output=output,
        overrides=(*fitted, *overrides),
        trace=trace,
    )
    outcome = execute(request)
    flags = outcome.document.flags if outcome.document is not None else ()
    untried = [flag for flag in flags if flag.code == NOT_TRIED]
    if outcome.exit_code in (EXIT_DONE, EXIT_UNDETERMINED) and untried:
        outcome.exit_code = EXIT_FAULT
    return report_outcome(outcome, PLAN, as_json=as_json)
