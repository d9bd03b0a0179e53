"""`station run`, also `--dry-run`, and `station resume`."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from station.cli.analysing import print_document
from station.cli.remembering import remember, standing_alarms
from station.cli.validating import read_bench_named, read_plan_for, read_served
from station.console import OutputLost, span, tell
from station.control.channel import go_on
from station.errors import (
    EXIT_ABORTED,
    EXIT_DONE,
    EXIT_FAULT,
    EXIT_INTERLOCK,
    EXIT_UNDETERMINED,
    InputError,
)
from station.files.locks import is_held
from station.files.yaml.reading import read_yaml
from station.findings import NOT_TRIED
from station.instruments.whole_bench import IN_USE
from station.procedure import procedure_of
from station.record.events import not_known, whole_bench
from station.record.folder import REPORT, RunFolder
from station.record.layout import EVENTS, LOCK
from station.recorded import read_plan_and_bench
from station.results import SCHEMA
from station.roles.role import role, role_of
from station.runner.dry_run import DryRunReport, Extreme, walk
from station.runner.execute import Request, execute
from station.runner.outcome import Outcome
from station.runner.resources import in_bytes
from station.runner.resuming import ResumeRequest, resume
from station.safety.witness import not_asked
from station.speech import joined, padded, said, show

if TYPE_CHECKING:
    from station.files.plan import Plan
    from station.instruments.bench import Bench
    from station.method.duration import Duration


# `station run`.

COMMISSIONING = "commissioning"
ANNOUNCE = "STATION_ANNOUNCE"
"""Names the file into which a detached run writes its folder; only `--detach` sets it."""


def run_plan(
    plan_name: str,
    bench_name: str,
    *,
    non_interactive: bool,
    answers: Path | None,
    served: Path | None,
    output: Path,
    as_json: bool,
    overrides: Sequence[str] = (),
    trace: bool = False,
    rehearse: bool = False,
) -> int:
    """Run a plan, say how it ended, and return the exit code."""
    request = request_of(
        plan_name,
        bench_name,
        non_interactive=non_interactive,
        answers=answers,
        served=served,
        output=output,
        overrides=overrides,
        trace=trace,
        rehearse=rehearse,
    )
    alarms = standing_alarms(request.bench.path.stem, output)
    outcome = execute(replace(request, warned=alarms))
    exit_code = report_outcome(outcome, request.plan.procedure, as_json=as_json)
    remember(outcome.folder)
    return exit_code


def request_of(
    plan_name: str,
    bench_name: str,
    *,
    non_interactive: bool,
    answers: Path | None,
    output: Path,
    served: Path | None = None,
    overrides: Sequence[str] = (),
    trace: bool = False,
    rehearse: bool = False,
) -> Request:
    """Return what the command line asks for; raises InputError and FaultList."""
    bench = read_bench_named(bench_name)
    if rehearse and bench.simulation is None and served is None:
        raise InputError(
            "--rehearse is for a simulated bench, where no operator would be asked; "
            f"{bench.name} is a real one, and asks in every run"
        )
    plan = read_plan_for(plan_name, bench, overrides)
    announce = announcement()
    return Request(
        plan,
        bench,
        output,
        answers=read_answers(answers) if answers else {},
        interactive=may_ask(non_interactive=non_interactive, attached=announce is not None),
        served=read_served(served) if served else None,
        trace=trace,
        rehearse=rehearse,
        announce=announce,
    )


def may_ask(*, non_interactive: bool, attached: bool = False) -> bool:
    """Whether a person can be asked, and nobody said otherwise.

    There is a terminal, or the run is detached and whoever is `attached` to it answers.
    """
    in_ci = os.environ.get("CI", "").lower() == "true"
    return not non_interactive and not in_ci and (attached or sys.stdin.isatty())


def announcement() -> Path | None:
    """Return where this process announces its run folder; None where it is not detached."""
    place = os.environ.pop(ANNOUNCE, None)
    return Path(place) if place else None


def report_outcome(outcome: Outcome, procedure: str, *, as_json: bool) -> int:
    """Say how a run ended and print its results; return the exit code."""
    report_end(outcome)
    try:
        print_outcome(outcome, procedure, as_json=as_json)
        outcome.ask_at_the_end()
    except OutputLost as error:
        tell(f"{error}; the run folder has them")
        ended = outcome.exit_code in (EXIT_ABORTED, EXIT_INTERLOCK)
        return outcome.exit_code if ended else EXIT_FAULT
    return outcome.exit_code


def leave_nothing_untried(outcome: Outcome) -> None:
    """Have a commissioning of which anything was not tried end with 3: it proves no bench."""
    flags = outcome.document.flags if outcome.document is not None else ()
    untried = any(flag.code == NOT_TRIED for flag in flags)
    if untried and outcome.exit_code in (EXIT_DONE, EXIT_UNDETERMINED):
        outcome.exit_code = EXIT_FAULT


def print_outcome(outcome: Outcome, procedure: str, *, as_json: bool) -> None:
    """Print the results on standard output, as one JSON document or for a person."""
    if as_json:
        print(json.dumps(document_of(outcome, procedure), indent=1, ensure_ascii=False))
    elif outcome.document is not None:
        print_document(outcome.document)
        show(f"report: {outcome.folder / REPORT}")


def read_answers(path: Path) -> dict[str, str]:
    """Return the prompt ids and answers of a YAML file."""
    data = read_yaml(path).data
    if not isinstance(data, dict):
        raise InputError(f"{path}: write prompt ids and answers, one `id: answer` a line")
    return {str(key): str(value) for key, value in data.items()}


def report_end(outcome: Outcome) -> None:
    """Tell the technician on standard error how the run and the bench ended."""
    if outcome.error is not None:
        tell(f"\nthe run did not finish: {outcome.error}")
    for reading in outcome.unsafe:
        read_back = reading.read_back.removeprefix(f"{reading.instrument}: ")
        if not reading.used:
            tell(
                f"NOT VERIFIED: {reading.instrument}, which this run did not use, is not at rest "
                f"({read_back}); switch it off by hand, or by the run that uses it"
            )
            continue
        if reading.doubted:
            tell(
                f"NOT VERIFIED: {reading.instrument} may still be on: {read_back}; look at it and "
                "at what stands in the coil, switch off by hand, then `station acknowledge` the "
                "bench"
            )
            continue
        declared = role(role_of(reading.instrument))
        wanted = declared and declared.safe_state
        where = f", which is: {wanted.brought_to}" if wanted else ""
        tell(
            f"NOT VERIFIED: {reading.instrument} could not be proven safe ({read_back}); bring it "
            f"by hand to its safe state{where}"
        )
    if outcome.left_to:
        tell(outcome.left_to)
    for report in outcome.witness_reports:
        if words := not_asked(report):
            tell(words)
    for reading in outcome.safe:
        if reading.skipped:
            tell(f"{reading.instrument}: {reading.skipped}")
    left_out = [
        {"instrument": left.instrument, "why": why_short(left.why, outcome.error or "")}
        for left in outcome.left_out
    ]
    if (outcome.safe or outcome.outside) and not outcome.unsafe:
        tell(whole_bench(left_out, outcome.read_when))
    elif left_out:
        tell(not_known(left_out))
    tell(f"run folder: {outcome.folder}")
    if outcome.error is not None and outcome.document is None:
        refused = outcome.exit_code == EXIT_INTERLOCK or outcome.doubted
        first = "; first `station acknowledge` the bench" if refused else ""
        tell(f"to go on where it stopped: station resume {quote(str(outcome.folder))}{first}")


def why_short(why: str, error: str) -> str:
    """Return why an instrument was not read; who has it is named once, as in the error."""
    who = why.removeprefix(IN_USE)
    return f"{IN_USE}that process" if who != why and who in error else why


def document_of(outcome: Outcome, procedure: str) -> dict[str, Any]:
    """Return the result document with what `run` adds: folder, exit code, safety, error."""
    if outcome.document is not None:
        data = outcome.document.to_data()
    else:
        data = {
            "schema": SCHEMA,
            "procedure": procedure,
            "verdict": "none",
            "results": [],
            "as_published": [],
            "flags": [],
        }
    return {
        **data,
        "run": str(outcome.folder),
        "exit_code": outcome.exit_code,
        "error": outcome.error,
        "safe_state": [reading.to_data() for reading in outcome.safe],
        "outside": [reading.to_data() for reading in outcome.outside],
        "left_out": [left.to_data() for left in outcome.left_out],
    }


def resume_run(
    folder: Path,
    bench_name: str | None,
    *,
    served: Path | None,
    answers: Path | None,
    non_interactive: bool,
    trace: bool,
    as_json: bool,
    rehearse: bool = False,
) -> int:
    """Go on with a run: one that is paused in another process, or one that ended too early."""
    if not (folder / EVENTS).is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    if is_held(folder / LOCK):
        if not go_on(folder):
            raise InputError(f"{folder} is being run and is not paused; see `station status`")
        tell(f"{folder} goes on in its own process")
        if as_json:
            print(json.dumps({"run": str(folder), "went_on": True, "exit_code": EXIT_DONE}))
        return EXIT_DONE
    plan, _ = read_plan_and_bench(RunFolder(folder))
    announce = announcement()
    request = ResumeRequest(
        folder,
        read_bench_named(bench_name) if bench_name else None,
        answers=read_answers(answers) if answers else {},
        interactive=may_ask(non_interactive=non_interactive, attached=announce is not None),
        served=read_served(served) if served else None,
        trace=trace,
        rehearse=rehearse,
        announce=announce,
    )
    outcome = resume(request)
    if plan.procedure == COMMISSIONING:
        leave_nothing_untried(outcome)
    exit_code = report_outcome(outcome, plan.procedure, as_json=as_json)
    remember(outcome.folder)
    return exit_code


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
        head = {"procedure": plan.procedure, "dut": dut_of(plan), "bench": bench.name}
        document = {"dry_run": True, **head, **walked.to_data()}
        print(json.dumps(document, indent=1, ensure_ascii=False))
    else:
        for line in dry_run_lines(walked, plan, bench):
            print(line)
    for warning in walked.warnings:
        tell(f"WARNING: {warning}")
    return EXIT_DONE


def dut_of(plan: Plan) -> dict[str, str]:
    """Return model and serial number of the device under test."""
    return {"model": plan.dut.model, "serial": plan.dut.serial}


def dry_run_lines(walked: DryRunReport, plan: Plan, bench: Bench) -> Iterator[str]:
    """Yield the walk as a table of steps and set-points, and what it comes to."""
    title = procedure_of(plan.procedure).title
    yield f"{said(title)}: {plan.dut.model} {plan.dut.serial}, {said(f'bench {bench.name}')}"
    yield f"{padded('step', 7)}{padded('begins at', 13)}{said('takes')}"
    for step in walked.steps:
        when = f"{span(step.starts_s):<12} {span(step.duration.expected_s):<12}"
        yield f"{step.step:<6} {when} {said(step.title)}"
        if not step.duration.is_certain:
            yield said(f"{'':<33}takes {bounds_in_words(step.duration)}")
        points = ((said(point.instrument), said(point.text)) for point in step.set_points)
        for (instrument, text), _ in groupby(points):
            yield f"{'':<33}{instrument}: {text}"
    yield ""
    for extreme in walked.extremes:
        yield summary_line(f"{extreme.which} {extreme.quantity}", extreme_in_words(extreme))
    takes = f"{span(walked.duration.expected_s)} of bench time"
    if not walked.duration.is_certain:
        takes = f"{takes}, {bounds_in_words(walked.duration)}"
    yield summary_line("expected duration", takes)
    yield summary_line("estimated end", estimated_end(walked))
    disk = walked.disk
    needed, free = in_bytes(disk.needed_bytes), in_bytes(disk.free_bytes)
    yield summary_line("disk space needed", f"about {needed}, free below {disk.folder}: {free}")
    memory = walked.memory
    needs = [f"about {in_bytes(memory.needed_bytes)} to evaluate"]
    if memory.fitted_bytes is not None:
        needs.append(f"this computer has {in_bytes(memory.fitted_bytes)}")
    yield summary_line("memory needed", joined(needs))
    yield said("dry run: no instrument was opened and nothing was written")


def bounds_in_words(duration: Duration) -> str:
    """Return between which bounds a duration lies: `2 min 00 s to 5 min 00 s`."""
    return f"{span(duration.shortest_s)} to {span(duration.longest_s)}"


def summary_line(name: str, text: str) -> str:
    """Return one line of the summary."""
    return f"{padded(name, 21)}{said(text)}"


def extreme_in_words(extreme: Extreme) -> str:
    """Return an extreme as text: `3.33 A (coil_supply.x)`."""
    if extreme.value is None:
        return f"{said(extreme.note)} ({said(extreme.instrument)})"
    where = joined(filter(None, (extreme.instrument, extreme.note)))
    return f"{extreme.value:.4g} {extreme.unit} ({where})"


def estimated_end(walked: DryRunReport) -> str:
    """Return when a run that begins now would end, or why that is unknown."""
    if walked.speed is None:
        return "unknown: a simulated bench runs on virtual time, where waiting is skipped"
    if walked.ends_utc is None:
        return "beyond all calendars"
    ends = f"{walked.ends_utc:%Y-%m-%d %H:%M}"
    if walked.speed == 1.0:
        return f"{ends} UTC if it begins now"
    return f"{ends} UTC if it begins now, at {walked.speed:g} times real time"
