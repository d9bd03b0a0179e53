"""`station commission`: the commissioning plan, fitted to a bench, and its weekly check."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from station.cli.running import report_outcome, request_of
from station.cli.validating import read_bench_named
from station.console import tell
from station.instruments.bench import Bench
from station.procedure import procedure_of
from station.results import ResultDocument
from station.runner.execute import execute
from station.safety.acknowledgement import remember

PLAN = "commissioning"
DRIFT = "drift"


def commission_bench(
    bench_name: str,
    overrides: Sequence[str],
    non_interactive: bool,
    answers: Path | None,
    output: Path,
    *,
    check: bool,
    as_json: bool,
) -> int:
    """Run the shipped plan on a bench, or its short form, and return the exit code of the run.

    The plan is fitted to the bench, as far as an override does not state otherwise. A bench that
    has drifted is not used again until a person acknowledges it.
    """
    bench = read_bench_named(bench_name)
    stated = {one.partition("=")[0] for one in overrides}
    fitted = [
        one for one in procedure_of(PLAN).fits(bench, check) if one.partition("=")[0] not in stated
    ]
    request = request_of(
        PLAN,
        bench_name,
        non_interactive=non_interactive,
        answers=answers,
        output=output,
        overrides=(*fitted, *overrides),
    )
    outcome = execute(request)
    if check and outcome.document is not None:
        remember_drift(bench, outcome.document, outcome.folder)
    return report_outcome(outcome, PLAN, as_json=as_json)


def remember_drift(bench: Bench, document: ResultDocument, run: Path) -> None:
    """Keep a bench from being used, as a tripped interlock does, where a figure has drifted."""
    drifted = [
        one.estimate.axis or ""
        for one in document.results
        if one.estimate.name == DRIFT and one.decision.verdict == "fail"
    ]
    if not drifted:
        return
    message = f"{', '.join(drifted)} drifted since the bench was commissioned"
    try:
        remember(bench.path, DRIFT, message, run, instruments_of(bench))
    except OSError as error:
        tell(f"the drift cannot be noted ({error}); do not use the bench until its cause is known")


def instruments_of(bench: Bench) -> dict[str, tuple[str, str]] | None:
    """Return the instruments of a real bench, address to model and serial; None of another."""
    if bench.simulation is not None:
        return None
    return {
        entry.address: ("", entry.serial or "")
        for entry in bench.instruments.values()
        if entry.address
    }
