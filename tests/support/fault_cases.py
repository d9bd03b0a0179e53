"""Where the fault campaign puts its faults: every kind, instrument and step of every shipped plan.

A plan joins by lying in `config/plans` and being valid on the simulated bench, an instrument by
being opened in a run of it, a fault by being declared for its simulator. Where a fault is put is
learnt from one run without faults: when each step began, and how many messages each instrument
had been sent by then.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from campaign_helpers import RawContent, raw_content
from quick_yaml import dump_yaml, load_yaml
from short_forms import SHORT_FORMS

from sim_instruments.bench import SimulatedBench, installed_worlds
from sim_instruments.faults.catalogue import applicable_faults
from sim_instruments.faults.wire import CAN, MEASURED, WIRE_FAULTS
from station import registry
from station.cli.validating import read_plan_for
from station.clock import VirtualClock
from station.control.status import RUN_STARTED
from station.files.faults import FaultList
from station.files.lookup import BENCHES, PLANS, available, find
from station.files.plan import Plan
from station.instruments.bench import Bench, read_bench
from station.procedure import Step, procedure_of
from station.record.folder import RunFolder, RunRecord
from station.runner.execute import conclude, head_of, inputs_of, what_is_planned
from station.runner.operator import Operator
from station.runner.outcome import Outcome
from station.runner.progress import Progress
from station.runner.run import Run
from station.runner.session import BenchSession
from station.runner.step_runner import StepRunner
from station.runner.trace import Trace

BENCH = "sim"
FIRST, MIDDLE, LASTING = "first message", "middle", "from the middle on"
LONG = "100 h"
BOARD_COMMANDS = {"can-pulse-board": 0x100, "can-navigator": 0x0A0, "can-imu": 0x0C0}
"""The frame by which a driver commands its instrument on a bus that others use as well."""


Options = tuple[tuple[str, str], ...]
VARIANTS: Mapping[str, tuple[Options, ...]] = {
    "stray-line": tuple((("where", one),) for one in ("ahead", "before", "behind", "after")),
    "duplicate-reply": ((), (("delay", "20 ms"),)),
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


def bench_data(bench: str = BENCH) -> dict[str, Any]:
    """Return the data of a simulated bench."""
    data: dict[str, Any] = load_yaml(find(BENCHES, bench).read_text(encoding="utf-8"))
    return data


def read_bench_at(path: Path) -> Bench:
    """Return the bench of a file."""
    return read_bench(path, registry.names(registry.DRIVERS))


def short(plan: str, bench: Bench) -> Plan:
    """Return a shipped plan in its short form; raises FaultList where it cannot run."""
    name = load_yaml(find(PLANS, plan).read_text(encoding="utf-8")).get("procedure", "")
    return read_plan_for(plan, bench, SHORT_FORMS.get(plan, SHORT_FORMS.get(str(name), ())))


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
    for name in (*procedure.instruments(read.parameters), "interlock_chain"):
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
        head = {**head_of(plan, bench, clock), **inputs_of(procedure, plan)}
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

        steps = [*map(marked, procedure.steps), Step("end", "", lambda run: mark(""), lambda _: 0)]
        operator = Operator(clock, {}, interactive=False, act=session.act)
        with Progress(1.0, quiet=True) as progress:
            planned = what_is_planned(plan, procedure, clock)
            record.event(RUN_STARTED, **planned, sha256={})
            run = Run(plan, bench, clock, record, progress, operator)
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
