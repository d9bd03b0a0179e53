"""`station commission`: the commissioning plan, fitted to a bench, and its weekly check."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from station.cli.running import COMMISSIONING, leave_nothing_untried, report_outcome, request_of
from station.cli.validating import read_bench_named
from station.procedure import procedure_of
from station.runner.execute import execute


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
    fits = procedure_of(COMMISSIONING).fits(bench, check, stated)
    fitted = [fit for fit in fits if fit.partition("=")[0] not in stated]
    request = request_of(
        COMMISSIONING,
        bench_name,
        non_interactive=non_interactive,
        answers=answers,
        output=output,
        overrides=(*fitted, *overrides),
        trace=trace,
    )
    outcome = execute(request)
    leave_nothing_untried(outcome)
    return report_outcome(outcome, COMMISSIONING, as_json=as_json)
