"""Go on with a run that ended before its end, from its last finished unit of work."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from station import registry
from station.clock import RealClock, utc_now
from station.control.questions import Operator
from station.errors import InputError
from station.files.plan import Plan
from station.guardian.notes import guardian_at_work
from station.instruments.bench import Bench, bench_of
from station.instruments.trace import Trace
from station.method.run import EarlierProgress
from station.procedure import Procedure, Prompt, procedure_of
from station.record.events import RESUMED, of_the_run
from station.record.folder import RESULTS, RunFolder, RunRecord
from station.record.integrity import sentence_of
from station.record.layout import EVENTS, RUN, covered_files, versions
from station.recorded import read_plan_and_bench, used_instruments
from station.runner.evaluation import (
    evaluate_run,
    exit_code_of,
    runs_backwards,
    silence,
    units_in_words,
)
from station.runner.execute import (
    DRIVERS,
    SERVED_SINCE,
    all_prompts,
    announce_folder,
    conclude,
    packages_of,
)
from station.runner.outcome import Outcome
from station.runner.preflight import SMALLEST_JUMP_S, watch_system_clock
from station.runner.progress import Progress, how_long
from station.runner.run import ActingRun
from station.runner.session import RESUME, BenchSession
from station.runner.step_runner import StepRunner
from station.safety.acknowledgement import refuse_until_acknowledged
from station.safety.drift import remember_drift

AS_BEFORE = Prompt(
    RESUME,
    "The run goes on where it stopped. Check that the device under test, its cables and the "
    "instruments are as they were.",
)
STAYS_OUT = (
    "What is damaged is not measured again, since what it was measured under may be gone: the "
    "verdict will be inconclusive at best."
)
SOFTWARE = ("station", "git_commit", "python", "packages", DRIVERS)
SAME_INSTRUMENT = ("driver", "serial", "settings", "limits", "calibration")


@dataclass(frozen=True)
class ResumeRequest:
    """What the command line asks for; `bench` replaces the one in the folder."""

    folder: Path
    bench: Bench | None = None
    answers: Mapping[str, str] = field(default_factory=dict)
    interactive: bool = False
    quiet: bool = False
    report: bool = True
    served: Mapping[str, Any] | None = None
    trace: bool = False
    rehearse: bool = False
    announce: Path | None = None
    """A file to write the run folder into: this process is detached, and has no terminal."""


def resume(request: ResumeRequest) -> Outcome:
    """Measure what is left of a run, and evaluate the whole.

    Raises InputError when there is nothing to go on with, when plan or bench are not those the run
    began with, or when a prompt would stay unanswered; NotAcknowledged as `execute`.
    """
    refuse_while_guarded(request.folder)
    folder = RunFolder(request.folder)
    if not folder.state.planned:
        raise InputError(f"{folder.path} never began; start it with `station run`")
    folder.damage.refuse_altered()
    plan, recorded_bench = read_plan_and_bench(folder)
    # To be read again a bench need not be of use, nor its drivers be installed; here it must.
    document = (request.bench or recorded_bench).document
    bench = bench_of(document, registry.names(registry.DRIVERS), bounded=True)
    procedure = procedure_of(plan.procedure)
    refuse_another_bench(folder, recorded_bench, bench)
    facts = folder.run_facts()
    bench_file = bench.path if request.bench else Path(facts.get("bench_file", bench.path))
    refuse_until_acknowledged(bench_file, [] if request.served else [*(bench.attached or ())])
    if folder.state.measured:
        outcome = evaluate_only(folder, request)
        remember_drift(bench.attached, bench_file, outcome.document, folder.path)
        return outcome
    refuse_another_world(folder, facts, request.served)
    stopped_s = folder.events[-1].time_s
    silent_s, behind_s = silent_since(folder), real_seconds_until(folder.path / EVENTS)
    began_s = stopped_s if bench.simulation is not None else stopped_s + silent_s
    with BenchSession(bench, plan.procedure, request.served, began_s) as session:
        clock = session.clock
        backwards_s = round(max(behind_s, stopped_s - clock.now()), 3)
        backwards: dict[str, Any] = (
            {"backwards_s": backwards_s} if backwards_s > SMALLEST_JUMP_S else {}
        )
        operator = Operator(
            clock,
            request.answers,
            interactive=request.interactive,
            act=session.act_again,
            rehearse=request.rehearse,
            detached=request.announce is not None,
        )
        past = past_of(folder, again=session.here)
        asked = [
            prompt
            for prompt in all_prompts(procedure, plan, bench)
            if prompt.id not in past.answered
        ]
        operator.check([AS_BEFORE, *asked])
        record = RunRecord.go_on(folder.path, clock)
        outcome = Outcome(record.path)
        announce_folder(request.announce, record.path)
        expected_s = procedure.walk(plan.parameters).duration().expected_s
        left = procedure.walk(plan.parameters, past)
        units = {unit: s for unit, s in left.units_expected.items() if unit not in past.finished}
        left_s = left.duration().expected_s
        with Progress(left_s, units=units, quiet=request.quiet, folder=record.path) as progress:
            changed = software_changes(facts)
            record.event(
                RESUMED,
                stopped_s=stopped_s,
                gap_s=round(max(clock.now() - stopped_s, 0.0), 3),
                silent_s=round(silent_s, 3),
                **backwards,
                segment=record.segment,
                units_finished=list(past.finished),
                software_changed=changed,
            )
            add_software(record, facts)
            ago = silence(silent_s, backwards)
            for line in sentences(record.path, procedure, plan, past, ago, changed):
                progress.say(line)
            if backwards:
                progress.say(f"WARNING: {runs_backwards(**backwards)}")
            for part in procedure.damage_of(folder, plan.parameters).parts:
                progress.say(f"WARNING: {sentence_of(part)} {STAYS_OUT}")
            progress.say(f"bench {bench.name}, {how_long(expected_s, clock)} for a whole run")
            record.after_unit.append(progress.unit_finished)
            watch_system_clock(record, clock)
            run = ActingRun(plan, bench, clock, record, progress, operator, past)
            trace = Trace(record.path, clock, record.segment) if request.trace else None
            StepRunner(run, procedure, session, bench_file, trace, first=AS_BEFORE).go(outcome)
    conclude(record, outcome, report=request.report)
    remember_drift(bench.attached, bench_file, outcome.document, record.path)
    run.notices.ended(outcome.sentence)
    outcome.ask_at_the_end = operator.ask_what_is_left
    return outcome


def refuse_while_guarded(folder: Path) -> None:
    """Raise InputError while a guardian is at work for the run: it has the instruments."""
    guardian = guardian_at_work(folder)
    if guardian is not None:
        raise InputError(
            f"{folder}: {guardian.sentence()}, and has its instruments; wait until it is done, or "
            f"end it with `station abort {folder}`"
        )


def evaluate_only(folder: RunFolder, request: ResumeRequest) -> Outcome:
    """Evaluate a run that was measured to its end and then interrupted; raises InputError."""
    operator = Operator(RealClock(), request.answers, interactive=request.interactive, act=None)
    operator.left += (
        Prompt(details["id"], details["text"]) for details in folder.state.process.left_for_the_end
    )
    evaluated = (folder.path / RESULTS).is_file()
    if evaluated and RESULTS in covered_files(folder.path):
        raise InputError(f"{folder.path} is finished; `station analyse` computes its results again")
    record = RunRecord.go_on(folder.path, RealClock())
    announce_folder(request.announce, record.path)
    record.close()
    outcome = Outcome(record.path, exit_code=0)
    if evaluated:  # only the manifest is missing
        outcome.document, _ = evaluate_run(folder)
        outcome.exit_code = exit_code_of(outcome.document)
        record.seal()
    else:
        conclude(record, outcome, report=request.report, ended=True)
    outcome.ask_at_the_end = operator.ask_what_is_left
    return outcome


def refuse_another_bench(folder: RunFolder, recorded: Bench, bench: Bench) -> None:
    """Raise InputError that names every instrument which is not the one the run began with."""
    different = []
    for name in used_instruments(folder):
        if name not in bench.instruments:
            different.append(f"{name} is missing")
            continue
        before, now = (vars(file.instruments[name]) for file in (recorded, bench))
        keys = [key for key in SAME_INSTRUMENT if before.get(key) != now.get(key)]
        if keys:
            different.append(f"{name}: another {', another '.join(keys)}")
    if different:
        listed = "".join(f"\n  - {difference}" for difference in dict.fromkeys(different))
        raise InputError(
            f"{bench.path} is not the bench this run began on; only addresses may differ:{listed}"
        )


def refuse_another_world(
    folder: RunFolder, facts: Mapping[str, Any], served: Mapping[str, Any] | None
) -> None:
    """Raise InputError where a run of a served bench would go on elsewhere, or the other way round.

    The instruments and the device would be others, and nothing in the record would show it.
    """
    was_served = facts.get(SERVED_SINCE) is not None
    if SERVED_SINCE not in facts or was_served == (served is not None):
        return
    command = f"`station resume {folder.path}"
    raise InputError(
        f"{folder.path} began on a bench that `station sim` serves, and cannot go on elsewhere; "
        f"type {command} --served FILE`, where FILE holds the first line of that `station sim`"
        if was_served
        else f"{folder.path} did not begin on a bench that `station sim` serves, and cannot go on "
        f"there; type {command}`, without --served"
    )


def past_of(folder: RunFolder, *, again: bool) -> EarlierProgress:
    """Return what the folder holds already; `again`: the acts of a person must be done again."""
    answered = {
        details["id"]: details["answer"]
        for details in folder.state.answered
        if not again and details.get("of") != "driver"
    }
    return EarlierProgress(folder.finished_units(), answered, folder.state.witnessed)


def silent_since(folder: RunFolder) -> float:
    """Return the real time in s since the run itself last wrote into its log."""
    later = folder.events[len(of_the_run(folder.events)) :]
    before_s = sum(float(event.details.get("silent_s", 0.0)) for event in later)
    written_s = (folder.path / EVENTS).stat().st_mtime
    return before_s + max(utc_now().timestamp() - written_s, 0.0)


def real_seconds_until(file: Path) -> float:
    """Return the real time in s until a file was last written, where the clock was set back."""
    return max(file.stat().st_mtime - utc_now().timestamp(), 0.0)


def software_changes(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of the software is not as it was: name to [before, now]."""
    now = present_software(facts)
    before = {key: facts.get(key) for key in SOFTWARE}
    pairs = dict(flat_pairs(before, {key: now.get(key) for key in SOFTWARE}))
    return {name: list(pair) for name, pair in pairs.items() if pair[0] != pair[1]}


def present_software(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the software that a run goes on with, by the names that its facts have."""
    return {**versions(), DRIVERS: packages_of(facts.get(DRIVERS, ()))}


def flat_pairs(
    before: Mapping[str, Any], now: Mapping[str, Any]
) -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Yield each name with its value before and now; the names of `packages` stand alone."""
    for key in now:
        if isinstance(now[key], Mapping):
            yield from flat_pairs(before.get(key) or {}, now[key])
        else:
            yield key, (before.get(key), now[key])


def add_software(record: RunRecord, facts: Mapping[str, Any]) -> None:
    """Add to run.json with which software, and when, the run went on."""
    resumed = [
        *facts.get("resumed", []),
        {"resumed_utc": utc_now().isoformat(timespec="seconds"), **present_software(facts)},
    ]
    record.write_json(RUN, json.loads(json.dumps({**facts, "resumed": resumed})))


def sentences(
    folder: Path,
    procedure: Procedure,
    plan: Plan,
    past: EarlierProgress,
    ago: str,
    changed: Mapping[str, Any],
) -> Iterator[str]:
    """Yield what the operator should know before the run goes on."""
    yield f"{procedure.title}: {plan.dut.model} {plan.dut.serial}"
    yield f"resumed in {folder}, last heard from {ago} ago"
    yield f"finished already, not measured again: {units_in_words(list(past.finished))}"
    if changed:
        listed = ", ".join(f"{name} {old} → {new}" for name, (old, new) in changed.items())
        yield f"WARNING: the software has changed since the run began: {listed}"
