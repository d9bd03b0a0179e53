"""Where the fault campaign puts its faults: every kind, instrument and step of every shipped plan.

A plan joins by lying in `config/plans` and being valid on the simulated bench, an instrument by
being opened in a run of it, a fault by being declared for its simulator. Where a fault is put is
learnt from one run without faults: when each step began, and how many messages each instrument
had been sent by then.
"""

from __future__ import annotations

import io
import json
import math
import re
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from campaign_helpers import RawContent, raw_content
from for_people import traces_in
from quick_yaml import dump_yaml, load_yaml
from short_forms import BENCH, SHORT_FORMS, bench_data, read_bench_at, short

from campaigns.truths import off_the_truth
from sim_instruments.bench import SimulatedBench, installed_worlds
from sim_instruments.faults.catalogue import applicable_faults
from sim_instruments.faults.wire import CAN, MEASURED, WIRE_FAULTS
from station.cli.running import report_outcome
from station.clock import VirtualClock
from station.control.questions import Operator
from station.errors import StationError
from station.files.faults import FaultList
from station.files.lookup import BENCHES, PLANS, available, find
from station.instruments.trace import Trace
from station.method.run import Run
from station.method.verbs import POLL_S
from station.procedure import Step, procedure_of
from station.record.events import RUN_STARTED, of_the_run
from station.record.folder import RunFolder, RunRecord
from station.runner.evaluation import evaluate_run
from station.runner.execute import Request, conclude, execute, head_of, inputs_of, what_is_planned
from station.runner.outcome import Outcome
from station.runner.progress import Progress
from station.runner.run import ActingRun
from station.runner.session import BenchSession
from station.runner.step_runner import StepRunner

FIRST, MIDDLE, LASTING = "first message", "middle", "from the middle on"
LONG = "100 h"
LATE = "0.9 s"
"""An instrument that hears, and answers after the deadline of an exchange."""
BOARD_COMMANDS = {"can-pulse-board": 0x100, "can-navigator": 0x0A0, "can-imu": 0x0C0}
"""The frame by which a driver commands its instrument on a bus that others use as well."""


Options = tuple[tuple[str, str], ...]
VARIANTS: Mapping[str, tuple[Options, ...]] = {
    "stray-line": tuple((("where", one),) for one in ("ahead", "before", "behind", "after")),
    "duplicate-reply": ((), (("delay", "20 ms"),)),
    "late": ((), (("delay", LATE),)),
}
"""Kinds that strike in more ways than one, by their options; the others come without."""


@dataclass(frozen=True)
class Case:
    """One fault at one place of one plan's run."""

    plan: str
    instrument: str
    kind: str
    step: str
    placement: str
    bench: str = BENCH
    options: Options = ()

    @property
    def role(self) -> str:
        """The role that the instrument plays."""
        return self.instrument.partition(".")[0]

    def __str__(self) -> str:
        where = "" if self.bench == BENCH else f"{self.bench} "
        how = "".join(f" {name} {value}" for name, value in self.options)
        return f"{where}{self.plan} {self.instrument} {self.kind}{how} {self.step} {self.placement}"


class Traffic(NamedTuple):
    """How many messages were sent, how many were answered, how many of those with a measurement."""

    sent: int = 0
    answered: int = 0
    measured: int = 0

    def met_by(self, kind: str, protocol: str) -> int:
        """Return how many of them a fault of a kind would have counted."""
        fault = WIRE_FAULTS.get(kind)
        if kind == "nan":
            return self.measured
        return self.sent if not (fault and fault.needs_reply) or protocol in CAN else self.answered


@dataclass(frozen=True)
class Mark:
    """The beginning of a step: when, and what had been on each instrument's wire by then."""

    step: str
    time_s: float
    traffic: Mapping[str, Traffic]


@dataclass(frozen=True)
class Reference:
    """A run without faults: how it went, where its steps began, what it recorded."""

    folder: Path
    outcome: Outcome
    world: dict[str, Any]
    marks: tuple[Mark, ...]
    """One for each step and one for the end of the last."""
    raw: Mapping[str, RawContent]
    instruments: Mapping[str, tuple[str, str]]
    """Protocol and driver of each simulated instrument that the run opened."""
    bench: str = BENCH

    def begins(self, step: str) -> int:
        """Return the place of a step's mark."""
        return next(k for k, mark in enumerate(self.marks) if mark.step == step)

    def entry(self, case: Case) -> dict[str, Any] | None:
        """Return the fault of a case as a bench file has it, None where it finds no place."""
        here, after = self.marks[(k := self.begins(case.step))], self.marks[k + 1]
        protocol, driver = self.instruments[case.instrument]
        on_wire = case.kind in WIRE_FAULTS
        fault: dict[str, Any] = {"instrument": case.instrument, "fault": case.kind}
        fault |= dict(case.options)
        if case.placement == FIRST:
            before, by_then = (
                mark.traffic.get(case.instrument, Traffic()).met_by(case.kind, protocol)
                for mark in (here, after)
            )
            if by_then == before:
                return None
            if protocol in CAN:
                fault["command"] = BOARD_COMMANDS[driver]
            return {**fault, "nth": before + 1}
        if case.placement == LASTING and not on_wire:
            return None
        fault["at"] = f"{(here.time_s + after.time_s) / 2:.6f} s"
        return {**fault, "for": LONG} if case.placement == LASTING else fault


def plans(bench_name: str = BENCH) -> list[str]:
    """Return the plans that are valid on a simulated bench; of variants those with an entry."""
    bench, found = read_bench_at(find(BENCHES, bench_name)), []
    for name, _ in available(PLANS):
        with suppress(FaultList):
            procedure = short(name, bench).procedure
            if procedure in installed_worlds() and name in (procedure, *SHORT_FORMS):
                found.append(name)
    return found


def all_cases(plan: str, reference: Reference) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Yield every case of a plan with its fault; what two cases have in common comes once."""
    seen: set[str] = set()
    for instrument, (protocol, driver) in reference.instruments.items():
        kinds = [
            (kind, options)
            for kind in applicable_faults(protocol, driver)
            for options in VARIANTS.get(kind, ((),))
        ]
        places = product(kinds, reference.marks[:-1], (FIRST, MIDDLE, LASTING))
        for (kind, options), mark, placement in places:
            case = Case(plan, instrument, kind, mark.step, placement, reference.bench, options)
            entry = reference.entry(case)
            if entry is not None and repr(entry) not in seen:
                seen.add(repr(entry))
                yield case, entry


def roles_and_kinds(plan: str, bench_name: str = BENCH) -> list[tuple[str, str]]:
    """Return every kind of fault of every role that a plan needs, chosen without a run."""
    bench = read_bench_at(find(BENCHES, bench_name))
    read = short(plan, bench)
    procedure = procedure_of(read.procedure)
    simulated = served(read.procedure, bench_name)
    pairs: dict[tuple[str, str], None] = {}
    for name in (*procedure.walk(read.parameters).instruments, "interlock_chain"):
        if name in simulated:
            driver = bench.instruments[name].driver
            kinds = applicable_faults(simulated[name], driver)
            pairs |= {(name.partition(".")[0], kind): None for kind in kinds}
    return list(pairs)


def steps(plan: str) -> list[str]:
    """Return the numbers of the steps of a plan's procedure."""
    read = short(plan, read_bench_at(find(BENCHES, BENCH)))
    return [step.number for step in procedure_of(read.procedure).steps]


@lru_cache
def served(procedure: str, bench: str = BENCH) -> Mapping[str, str]:
    """Return the simulated instruments of a procedure's bench with their protocols."""
    simulated = SimulatedBench(bench_data(bench), VirtualClock(), procedure)
    simulated.close()
    return {name: str(one["protocol"]) for name, one in simulated.instruments.items()}


def reference_run(plan_name: str, folder: Path, bench_name: str = BENCH) -> Reference:
    """Run a plan without faults and note where its steps begin."""
    folder.mkdir(parents=True, exist_ok=True)
    world, bench_file = folder / "world.json", folder / "bench.yaml"
    data = bench_data(bench_name)
    data["simulation"]["report"] = str(world)
    bench_file.write_text(dump_yaml(data), encoding="utf-8")
    bench = read_bench_at(bench_file)
    plan = short(plan_name, bench)
    procedure, simulated = procedure_of(plan.procedure), served(plan.procedure, bench_name)
    marks: list[Mark] = []
    with BenchSession(bench, plan.procedure) as session:
        clock = session.clock
        head: dict[str, Any] = {**head_of(plan, bench, clock), **inputs_of(procedure, plan)}
        record = RunRecord(folder / "runs", plan.procedure, plan.dut.serial, clock, head)
        outcome = Outcome(record.path)
        trace = Trace(record.path, clock)

        def mark(step: str) -> None:
            counts = {name: traffic(trace.folder / f"{name}.txt") for name in simulated}
            marks.append(Mark(step, clock.now(), counts))

        def marked(step: Step) -> Step:
            def body(run: Run) -> None:
                mark(step.number)
                step.body(run)

            return replace(step, body=body)

        steps = [*map(marked, procedure.steps), Step("end", "", lambda run: mark(""))]
        operator = Operator(clock, {}, interactive=False, act=session.act)
        with Progress(1.0, quiet=True) as progress:
            planned = what_is_planned(plan, procedure, clock)
            record.event(RUN_STARTED, **planned, sha256={})
            run = ActingRun(plan, bench, clock, record, progress, operator)
            walked = replace(procedure, steps=steps)
            StepRunner(run, walked, session, bench.path, trace).go(outcome)
    conclude(record, outcome, report=False)
    assert outcome.exit_code in (0, 1, 6), (outcome.exit_code, outcome.error)
    opened = {one.details["instrument"] for one in RunFolder(record.path).events_of("identified")}
    return Reference(
        record.path,
        outcome,
        load_yaml(world.read_text(encoding="utf-8")),
        tuple(marks),
        {file.name: raw_content(file) for file in sorted((record.path / "raw").iterdir())},
        {
            name: (protocol, bench.instruments[name].driver)
            for name, protocol in simulated.items()
            if name in opened
        },
        bench_name,
    )


def traffic(trace: Path) -> Traffic:
    """Return what a trace says was on its wire."""
    sent = answered = measured = 0
    for line in trace.read_text(encoding="utf-8").splitlines() if trace.is_file() else ():
        found = re.match(r"\s*[\d.]+ ([<>]) (.*)", line)
        if found:
            sent += found[1] == ">"
            answered += found[1] == "<"
            measured += found[1] == "<" and bool(MEASURED.search(found[2].encode()))
    return Traffic(sent, answered, measured)


@dataclass
class Ended:
    """A run with a fault, after its end."""

    outcome: Outcome | None
    exit_code: int
    error: str
    said: str
    world: dict[str, Any]
    left_behind: list[str]
    warned: list[str]
    """Warnings of the program's own parts, which an operator would see and not understand."""

    @property
    def folder(self) -> RunFolder | None:
        """The run's folder, None where it never got one."""
        return RunFolder(self.outcome.folder) if self.outcome else None

    @property
    def first_s(self) -> float | None:
        """When the fault struck first."""
        first: float | None = self.world["faults"][0]["first_s"]
        return first


def run_case(case: Case, entry: Mapping[str, Any], folder: Path) -> Ended:
    """Run a plan with a fault, in this process on virtual time."""
    folder.mkdir(parents=True)
    data = bench_data(case.bench)
    report = folder / "world.json"
    data["simulation"] |= {"report": str(report), "faults": [dict(entry)]}
    (folder / "bench.yaml").write_text(dump_yaml(data), encoding="utf-8")
    bench = read_bench_at(folder / "bench.yaml")
    request = Request(short(case.plan, bench), bench, folder / "runs", quiet=True, report=False)
    before, children = set(threading.enumerate()), child_processes()
    said = io.StringIO()
    outcome, error, exit_code = None, "", 0
    with (
        redirect_stderr(said),
        redirect_stdout(said),
        warnings.catch_warnings(record=True) as warned,
    ):
        warnings.simplefilter("always")
        try:
            outcome = execute(request)
            exit_code = report_outcome(outcome, request.plan.procedure, as_json=False)
            error = outcome.error or ""
        except StationError as raised:
            exit_code, error = raised.exit_code, str(raised)
    threads = set(threading.enumerate()) - before
    for thread in threads:
        thread.join(10)
    left = [thread.name for thread in threads if thread.is_alive()]
    left += [f"process {one}" for one in child_processes() - children]
    assert report.is_file(), f"{case}: the world gave no account of itself: {error}"
    world = json.loads(report.read_text(encoding="utf-8"))
    remarks = [f"{one.category.__name__}: {one.message}" for one in warned]
    return Ended(outcome, exit_code, error, said.getvalue(), world, left, remarks)


def child_processes() -> set[str]:
    """Return the children of this process; nothing where the system does not tell."""
    lists = Path("/proc/self/task").glob("*/children") if sys.platform == "linux" else ()
    return {child for one in lists for child in one.read_text(encoding="utf-8").split()}


NOTHING_LEFT_A = 0.001
GOOD, FAULT, TRIPPED = frozenset({0, 1, 6}), 3, 5
SAFE_STATE_S, STEP_WAITS_S = 120.0, 420.0
"""Bench time that the safe state of one instrument, and the waits of a step, may take."""
LONG_WAITS_S: Mapping[str, float] = {"fog-scale-factor-temperature": 2700.0}
"""Procedures whose steps wait longer: 20 min for a temperature, then 20 min for an alignment."""
STEP_OF_A_RAMP_A = 0.25
STEPS_BY_ITSELF = frozenset({"compliance", "overdrive"})
COMES_ON_BY_ITSELF = frozenset({"comes-back"})
ITS_OWN_STEP_S, OVERDRIVEN = 0.5, 3.5
"""The current of a supply with such a fault jumps when the fault begins."""
PROTECTED = "the output went off"
"""Its own protection cuts a coil that is driven beyond the supply's limit."""
UNREACHABLE = frozenset({"port-gone", "stuck-open", "lies"})
"""Nobody can do anything to an instrument with this fault any more."""
TOGGLED = frozenset({"pump_laser"})
"""One command opens and closes it: while nothing it says is understood, nobody may send that."""
LOST_WHILE_LASTING = frozenset({"lost-command"})
MUST_TRIP_WITHIN_S = {"chain-open": 1.5, "overheating": 15.0}
"""What puts somebody or something at risk ends a run, in the time between two looks at it."""
MUST_BE_FOUND_WITHIN_S = {("imu", "frozen"): 15.0}
"""What no measurement can be made with ends a run, in the time between two records of one."""


@dataclass
class Verdict:
    """What became of a case: how the run ended and what is wrong with that."""

    case: Case
    struck: bool
    exit_code: int
    energised: bool
    to_zero_s: float | None
    """Bench time from the fault to the last coil's driven current being zero, where one flowed."""
    to_verified_s: float | None
    """Bench time from the fault to the end of the safe state, all read back."""
    sentence: str
    violations: list[str] = field(default_factory=list)


def judge(case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference) -> Verdict:
    """Return what is wrong with how a run with a fault ended."""
    first_s = ended.first_s
    coils = ended.world["coils"].values()
    zero_s = [one["at_zero_since_s"] for one in coils if one["largest_current_A"] > NOTHING_LEFT_A]
    energised = first_s is not None and any(since is None or since > first_s for since in zero_s)
    to_zero_s = to_verified_s = None
    if energised and first_s is not None and ended.exit_code in (FAULT, TRIPPED):
        if None not in zero_s:
            to_zero_s = max(zero_s) - first_s
        if ended.folder is not None and ended.outcome is not None and not ended.outcome.unsafe:
            (safe,) = ended.folder.events_of("safe-state")
            to_verified_s = safe.time_s - first_s
    verdict = Verdict(
        case, first_s is not None, ended.exit_code, energised, to_zero_s, to_verified_s, ended.error
    )
    for check in (world_is_safe, told_well, recorded, results_are_right, nothing_is_left):
        verdict.violations += check(case, entry, ended, reference)
    return verdict


def is_safe(world: Mapping[str, Any]) -> bool:
    """Whether nothing that can harm is energised in a simulated world."""
    driven = [abs(coil["driven_A"]) for coil in world["coils"].values()]
    return not any(world["outputs"].values()) and max(driven, default=0.0) < NOTHING_LEFT_A


def at_rest(case: Case, ended: Ended) -> bool:
    """Whether the world is at rest; an output that nobody can switch off may be on at 0 A."""
    driven = [abs(coil["driven_A"]) for coil in ended.world["coils"].values()]
    nothing_flows = max(driven, default=0.0) < NOTHING_LEFT_A
    return is_safe(ended.world) or (case.kind == "lies" and nothing_flows)


def world_is_safe(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """The world is at rest, and came there gently; only what nobody reaches may be left, named."""
    unsafe = {one.instrument for one in ended.outcome.unsafe} if ended.outcome else set()
    lost = case.kind in LOST_WHILE_LASTING or case.role in TOGGLED
    lasting = "for" in entry or case.kind == "chatter"
    out_of_reach = case.kind in UNREACHABLE or (lost and lasting)
    if not at_rest(case, ended):
        on = sorted(name for name, is_on in ended.world["outputs"].items() if is_on)
        if not (out_of_reach and on == [case.instrument] and case.instrument in unsafe):
            yield f"the world is not safe: {on} on, unverified {sorted(unsafe)}"
    if unsafe:
        if ended.exit_code != FAULT:
            yield f"{sorted(unsafe)} was not verified and the exit code is {ended.exit_code}"
        for name in unsafe:
            if f"NOT VERIFIED: {name} " not in ended.said:
                yield f"{name} was not verified and the operator was not told"
        return
    for name, coil in ended.world["coils"].items():
        allowed_A = max(
            STEP_OF_A_RAMP_A,
            1.2 * largest_step_A(reference.world["coils"][name]) + NOTHING_LEFT_A,
        )
        if case.kind == "overdrive":
            allowed_A *= OVERDRIVEN
        at_the_fault = abs(coil["largest_slew_at_s"] - (ended.first_s or 0.0)) < ITS_OWN_STEP_S
        if case.kind in STEPS_BY_ITSELF and (at_the_fault or PROTECTED in ended.error):
            continue
        if f"coil_supply.{name}" in switched_off_at_once(ended) or (
            case.kind in COMES_ON_BY_ITSELF
        ):
            continue
        if largest_step_A(coil) > allowed_A:
            yield f"coil {name} was cut: a step of {largest_step_A(coil):.2f} A"


def switched_off_at_once(ended: Ended) -> set[str]:
    """Return the instruments that did not do what they were asked: these may be cut off."""
    if ended.folder is None:
        return set()
    events = ended.folder.events_of("switched-off-at-once")
    return {str(one.details["instrument"]) for one in events}


def largest_step_A(coil: Mapping[str, Any]) -> float:
    """Return the largest step that a supply made against the current of a coil."""
    return float(coil["largest_slew_A_per_s"] * coil["time_constant_s"])


def told_well(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """The exit code is one that the fault may have, and the sentence helps."""
    code = ended.exit_code
    if code not in GOOD | {FAULT, TRIPPED}:
        yield f"exit code {code}"
    if "a fault of the program" in ended.said:
        yield f"a fault of the program: {ended.error}"
    yield from traces_in(ended.said + ended.error)
    yield from ended.warned
    if code in GOOD:
        still_s = reference.marks[-1].time_s - (ended.first_s or math.inf)
        found_s = MUST_BE_FOUND_WITHIN_S.get((case.role, case.kind), math.inf)
        if still_s > min(MUST_TRIP_WITHIN_S.get(case.kind, math.inf), found_s):
            yield f"{case.kind} {still_s:.1f} s before the end did not end the run"
        return
    if code == TRIPPED and "interlock" not in ended.error:
        yield f"exit code 5 without an interlock: {ended.error}"
    if ended.outcome and ended.outcome.unsafe:
        return  # the sentence is that about the safe state
    document = ended.outcome.document if ended.outcome else None
    if document and any(flag.code == "wrong-excitation" for flag in document.flags):
        return  # the sentence is that of the flag: no verdict on the device
    if ended.error == "":
        yield f"exit code {code} without a sentence"
    head, *more = ended.error.split("\n")
    if any(not line.startswith("  - ") for line in more):
        yield f"more than one line: {ended.error!r}"
    if case.instrument not in ended.error:
        yield f"the sentence does not name {case.instrument}: {ended.error}"
    if code == FAULT and ";" not in ended.error:
        yield f"the sentence does not say what to do: {head}"
    if len(ended.error) > 500:
        yield f"a sentence of {len(ended.error)} characters"


def recorded(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """The folder opens, what was recorded before the fault is in it, and it can be analysed."""
    folder = ended.folder
    if folder is None or ended.outcome is None:
        return
    if [event.kind for event in of_the_run(folder.events)][-1:] != ["run-ended"]:
        yield "the log does not end with the end of the run"
    until_s = (math.inf if ended.first_s is None else ended.first_s) - 2 * POLL_S
    for name, content in reference.raw.items():
        file = folder.path / "raw" / name
        there = raw_content(file).rows if file.is_file() else {}
        for unit, blocks in content.rows.items():
            wanted = sum(int((block["arrival_time_s"] < until_s).sum()) for block in blocks)
            kept = sum(
                int((block["arrival_time_s"] < until_s).sum()) for block in there.get(unit, [])
            )
            if kept < wanted:
                yield f"{name} {unit}: {kept} of {wanted} rows from before the fault"
    try:
        document, _ = evaluate_run(folder)
    except Exception as error:
        yield f"it cannot be analysed: {error!r}"
        return
    unsafe = not at_rest(case, ended) or bool(ended.outcome.unsafe)
    for one in (document, ended.outcome.document):
        if one is not None and unsafe and one.verdict == "pass":
            yield "the verdict is pass and the bench is not safe"


def results_are_right(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """Results that are called good are right."""
    document = ended.outcome.document if ended.outcome else None
    if ended.exit_code != 0 or document is None or document.verdict != "pass":
        return
    data = document.to_data()
    values = {(one["name"], one["axis"]): one["value"] for one in reference_results(reference)}
    for result in data["results"]:
        if result["value"] is None and values[result["name"], result["axis"]] is not None:
            yield f"pass without a value of {result['name']} {result['axis']}"
    flags = sorted({flag.code for flag in document.flags})
    for off in off_the_truth(bench_data(case.bench), data):
        yield f"{off}, pass; flags {flags}"


def reference_results(reference: Reference) -> list[dict[str, Any]]:
    """Return the results of the run without faults."""
    assert reference.outcome.document is not None
    results: list[dict[str, Any]] = reference.outcome.document.to_data()["results"]
    return results


def nothing_is_left(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """No thread, no process, and no more bench time than the waits of the procedure allow."""
    if ended.left_behind:
        yield f"left behind: {ended.left_behind}"
    allowed_s = (
        max(reference.marks[-1].time_s, ended.first_s or 0.0)
        + LONG_WAITS_S.get(case.plan, STEP_WAITS_S)
        + SAFE_STATE_S * len(ended.world["outputs"])
    )
    if ended.world["time_s"] > allowed_s:
        yield f"it took {ended.world['time_s']:.0f} s of bench time, {allowed_s:.0f} s are allowed"


def judged(case: Case, entry: Mapping[str, Any], reference: Reference, folder: Path) -> Verdict:
    """Run a case in a folder and hold it against what must be true whatever the fault was."""
    return judge(case, entry, run_case(case, entry, folder), reference)
