"""Execute a plan on a bench: look, record, have the steps walked, evaluate, seal."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from station import registry
from station.clock import Clock, system_clock_synchronised, utc_now
from station.console import tell
from station.control.questions import Operator
from station.control.signals import wishes_held
from station.errors import EXIT_ABORTED, EXIT_FAULT, EXIT_INTERLOCK, InputError, RecordError
from station.files.plan import Plan
from station.files.plan.resolved import resolved_text
from station.files.yaml.document import yaml_text
from station.instruments.bench import Bench
from station.instruments.trace import Trace
from station.procedure import Procedure, Prompt, procedure_of
from station.record.events import RUN_STARTED
from station.record.files import json_text, write_whole_file
from station.record.folder import RunFolder, RunRecord
from station.record.integrity import hash_of_data
from station.record.layout import BENCH, BENCH_AS_WRITTEN, EXPORTS, PLAN, RUN, versions
from station.runner.evaluation import conclude_run, exit_code_of
from station.runner.outcome import NO_MEMORY, Outcome, in_one_sentence, is_lack_of_memory
from station.runner.preflight import Warned, preflight, watch_system_clock
from station.runner.progress import Progress, how_long
from station.runner.room import prompts_of_room
from station.runner.run import ActingRun
from station.runner.session import BenchSession, Replay
from station.runner.step_runner import StepRunner
from station.safety.acknowledgement import refuse_until_acknowledged
from station.safety.drift import remember_drift

SERVED_SINCE = "served_since_unix"
"""In run.json: when the bench that `station sim` served began, None where nothing was served."""


DRIVERS = "drivers"
"""In run.json: name and version of the package of each driver of the bench."""


@dataclass(frozen=True)
class Request:
    """What the command line asks for."""

    plan: Plan
    bench: Bench
    output: Path
    answers: Mapping[str, str] = field(default_factory=dict)
    interactive: bool = False
    quiet: bool = False
    report: bool = True
    """Whether a report and an HDF5 file are made beside the results."""
    served: Mapping[str, Any] | None = None
    trace: bool = False
    rehearse: bool = False
    """Whether a person is asked for what the simulated world would do by itself."""
    announce: Path | None = None
    """A file to write the run folder into: this process is detached, and has no terminal."""
    replay: Replay | None = None
    """The transcript that takes the place of every instrument."""
    warned: Sequence[Warned] = ()
    """What the operator should know of the bench before this run."""


def execute(request: Request) -> Outcome:
    """Run a plan to its end, whatever that is; the bench is made safe in every case.

    Raises InputError before anything is energised when plan, bench or prompts do not fit,
    NotAcknowledged when an interlock of this bench tripped and nobody has looked.
    """
    plan, bench = request.plan, request.bench
    procedure = procedure_of(plan.procedure)
    if request.replay is None:
        refuse_until_acknowledged(bench.path, [] if request.served else [*(bench.attached or ())])
    with BenchSession(bench, plan.procedure, request.served, replay=request.replay) as session:
        clock = session.clock
        operator = Operator(
            clock,
            request.answers,
            interactive=request.interactive,
            act=session.act,
            rehearse=request.rehearse,
            detached=request.announce is not None,
        )
        operator.check(all_prompts(procedure, plan, bench))
        warned = [*request.warned]
        warned += preflight(plan, procedure, bench, request.output, clock, real=session.real)
        inputs = inputs_of(procedure, plan)
        head: dict[str, str | bytes] = {
            **head_of(plan, bench, clock, request.served),
            **inputs,
        }
        record = RunRecord(request.output, plan.procedure, plan.dut.serial, clock, head)
        outcome = Outcome(record.path)
        announce_folder(request.announce, record.path)
        walk = procedure.walk(plan.parameters)
        expected_s, units = walk.duration().expected_s, walk.units_expected
        with Progress(expected_s, units=units, quiet=request.quiet, folder=record.path) as progress:
            progress.say(f"{procedure.title}: {plan.dut.model} {plan.dut.serial}")
            progress.say(f"bench {bench.name}, {how_long(expected_s, clock)}")
            progress.say(f"recorded in {record.path}")
            planned = what_is_planned(plan, procedure, clock)
            hashes = {**content_hashes(plan, bench), **hashes_of(inputs)}
            record.event(RUN_STARTED, **planned, sha256=hashes)
            for warning in warned:
                progress.say(f"WARNING: {warning.sentence}")
                record.event(warning.kind, message=warning.sentence)
            record.after_unit.append(progress.unit_finished)
            watch_system_clock(record, clock)
            run = ActingRun(plan, bench, clock, record, progress, operator)
            trace = Trace(record.path, clock) if request.trace else None
            StepRunner(run, procedure, session, bench.path, trace).go(outcome)
    conclude(record, outcome, report=request.report)
    if request.replay is None:
        remember_drift(bench.attached, bench.path, outcome.document, record.path)
    run.notices.ended(outcome.sentence)
    outcome.ask_at_the_end = operator.ask_what_is_left
    return outcome


def announce_folder(place: Path | None, folder: Path) -> None:
    """Write where a detached run is recorded, for who began it."""
    if place is not None:
        write_whole_file(place, str(folder.resolve()).encode())


def what_is_planned(plan: Plan, procedure: Procedure, clock: Clock) -> dict[str, Any]:
    """Return the details of the event `run-started`; durations are bench time in s.

    `speed` is how many times as fast as real time the run goes, None where waiting is skipped.
    """
    walk = procedure.walk(plan.parameters)
    return {
        "procedure": plan.procedure,
        "dut": {"model": plan.dut.model, "serial": plan.dut.serial},
        "steps": [
            {"step": step.number, "title": step.title, **walk.duration(step.number).to_data()}
            for step in procedure.steps
        ],
        "units": list(walk.units),
        "units_expected": walk.units_expected,
        "speed": getattr(clock, "speed", None),
    }


def conclude(record: RunRecord, outcome: Outcome, *, report: bool, ended: bool = False) -> None:
    """Evaluate what was measured, seal the folder, and set the exit code that says it all.

    A folder that is no longer there is left alone: nothing is made in its place. That of a run
    that had `ended` before stays as its manifest has it.
    """
    try:
        record.presence.check()
    except RecordError as error:
        if outcome.error is None:
            outcome.error, outcome.exit_code = str(error), EXIT_FAULT
        return
    with wishes_held():
        try:
            if not ended:
                with suppress(RecordError):  # a full disk was reported when the run met it
                    note_end(record)
            evaluate(record, outcome, report=report)
            record.seal()
        except Exception as error:  # the operator must still read how the bench was left
            record.faults.append(in_one_sentence(error))
        if report and outcome.error is None and not record.faults:
            export(record)  # not on a disk that is full: the HDF5 library crashes there
    if record.faults and outcome.exit_code not in (EXIT_ABORTED, EXIT_INTERLOCK):
        outcome.error = outcome.error or f"not everything was recorded: {record.faults[0]}"
        outcome.exit_code = EXIT_FAULT


def note_end(record: RunRecord) -> None:
    """Add to run.json when the run ended."""
    facts = json.loads((record.path / RUN).read_text(encoding="utf-8"))
    record.write_json(RUN, {**facts, "ended_utc": utc_now().isoformat(timespec="seconds")})


def all_prompts(procedure: Procedure, plan: Plan, bench: Bench) -> list[Prompt]:
    """Return every prompt a run may show: the procedure's own and those of its drivers and room."""
    walk = procedure.walk(plan.parameters)
    prompts = list(walk.prompts)
    for name in walk.used_on(bench):
        if name in bench.instruments:
            driver = registry.load(registry.DRIVERS, bench.instruments[name].driver)
            asked: Mapping[str, str] = getattr(driver, "prompts", {})
            prompts.extend(Prompt(prompt_id, text) for prompt_id, text in asked.items())
    return [*prompts, *prompts_of_room(plan)]


def head_of(
    plan: Plan, bench: Bench, clock: Clock, served: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """Return the files that say what a run is asked to do; they stand before it does anything."""
    facts: dict[str, Any] = {
        "started_utc": utc_now().isoformat(timespec="seconds"),
        "clock": type(clock).__name__,
        SERVED_SINCE: served["clock"]["epoch_unix"] if served else None,
        "system_clock_synchronised": system_clock_synchronised(),
        "set": list(plan.overrides),
        "bench_file": str(bench.path.resolve()),
        **versions(),
        DRIVERS: packages_of(entry.driver for entry in bench.instruments.values()),
    }
    return {
        "plan.yaml": plan.text,
        BENCH_AS_WRITTEN: bench.text,
        PLAN: resolved_text(plan),
        BENCH: yaml_text(bench.to_yaml_data()),
        RUN: json_text(facts),
    }


def packages_of(drivers: Iterable[str]) -> dict[str, str]:
    """Return name and version of the package of each driver."""
    return {name: registry.package_of(registry.DRIVERS, name) for name in sorted({*drivers})}


def inputs_of(procedure: Procedure, plan: Plan) -> dict[str, bytes]:
    """Return the files that a plan names, by their places in the run folder.

    Raises FaultList or InputError where one cannot be read.
    """
    contents = {}
    for place, path in procedure.inputs(plan.parameters).items():
        try:
            contents[place] = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror}") from error
    return contents


def hashes_of(contents: Mapping[str, bytes]) -> dict[str, str]:
    """Return the SHA-256 of contents, by the same names."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}


def content_hashes(plan: Plan, bench: Bench) -> dict[str, str]:
    """Return the SHA-256 of what the resolved plan and bench say, whatever file it stands in."""
    contents = {"plan": plan.to_yaml_data(), "bench": bench.to_yaml_data()}
    return {name: hash_of_data(data) for name, data in contents.items()}


def export(record: RunRecord) -> None:
    """Leave the raw data as HDF5 for other tools; what cannot be exported now can be later."""
    try:
        from station.record.export.hdf5 import export_hdf5

        export_hdf5(RunFolder(record.path), record.path / EXPORTS / f"{record.path.name}.h5")
    except Exception as error:  # the record itself is complete without it
        why = NO_MEMORY if is_lack_of_memory(error) else error
        tell(f"not exported: {why}; `station export` does it again")


def evaluate(record: RunRecord, outcome: Outcome, *, report: bool) -> None:
    """Analyse a run that went through its steps, from what is on disk."""
    if outcome.error is not None:
        return
    try:
        outcome.document = conclude_run(record.path, report=report)
    except Exception as error:  # what was measured is on disk, whatever the evaluation does
        why = NO_MEMORY if is_lack_of_memory(error) else in_one_sentence(error)
        outcome.error = (
            f"the data are complete, their evaluation failed: {why}; "
            f"then run `station analyse {record.path}`"
        )
        outcome.exit_code = EXIT_FAULT
        return
    if outcome.exit_code == 0:
        outcome.exit_code = exit_code_of(outcome.document)
