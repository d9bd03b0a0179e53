"""Execute a plan on a bench: open, check, walk the steps, make safe, evaluate, seal."""

from __future__ import annotations

import json
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from station import registry
from station.bench import Bench
from station.clock import Clock, ClockError, system_clock_synchronised, utc_now
from station.console import tell
from station.errors import EXIT_ABORTED, EXIT_FAULT, EXIT_INTERLOCK, RecordError, StationError
from station.evaluation import conclude_run, exit_code_of
from station.plan import Plan
from station.plan.resolved import resolved_text
from station.procedure import Procedure, Prompt
from station.record.folder import EXPORTS, RUN, RunFolder, RunRecord, json_text
from station.runner.opening import Found, open_instruments
from station.runner.preflight import look_before_a_run, watch_system_clock
from station.runner.progress import Progress, how_long
from station.runner.prompts import Operator
from station.runner.run import Run
from station.runner.signals import AbortSignals, wishes_held
from station.runner.simulation import clock_for, serve_bench
from station.runner.trace import Trace
from station.safety.safe_state import SafeOutcome, make_bench_safe
from station.status import RUN_STARTED, what_is_planned
from station.versions import versions
from station.yaml.writing import yaml_text

if TYPE_CHECKING:
    from station.results import ResultDocument


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


@dataclass
class Outcome:
    """How a run ended."""

    folder: Path
    exit_code: int = EXIT_FAULT
    document: ResultDocument | None = None
    error: str | None = None
    safe: list[SafeOutcome] = field(default_factory=list)

    @property
    def unsafe(self) -> list[SafeOutcome]:
        """Instruments whose safe state could not be verified."""
        return [outcome for outcome in self.safe if not outcome.verified]


class BenchSession:
    """A bench that can be opened: a real one, one simulated here, or one that is served elsewhere.

    `addresses` are those of simulated instruments; `act` does a physical act in their world.
    `served` is the first line of `station sim`.
    """

    def __init__(
        self, bench: Bench, procedure: str, served: Mapping[str, Any] | None = None
    ) -> None:
        self.clock = clock_for(bench, served)
        self._simulation = None
        self.addresses: dict[str, str] = {}
        self.act: Callable[[str], str] | None = None
        if served is not None:
            self.addresses = {
                name: str(one["address"]) for name, one in served["instruments"].items()
            }
            self.act = lambda prompt_id: f"{prompt_id}: done when the simulated bench was served"
        elif bench.simulation is not None:
            self._simulation = serve_bench(bench, self.clock, procedure)
            instruments = self._simulation.instruments
            self.addresses = {name: str(one["address"]) for name, one in instruments.items()}
            self.act = self._simulation.act

    def __enter__(self) -> BenchSession:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._simulation is not None:
            self._simulation.close()
        self.clock.stop()


def execute(request: Request) -> Outcome:
    """Run a plan to its end, whatever that is; the bench is made safe in every case.

    Raises InputError before anything is energised when plan, bench or prompts do not fit.
    """
    plan, bench = request.plan, request.bench
    procedure = registry.procedure(plan.procedure)
    with BenchSession(bench, plan.procedure, request.served) as session:
        clock = session.clock
        operator = Operator(
            clock, request.answers, interactive=request.interactive, act=session.act
        )
        operator.check(all_prompts(procedure, plan, bench))
        real = bench.simulation is None and request.served is None
        warned = look_before_a_run(plan, procedure, bench, request.output, clock, real=real)
        record = RunRecord(
            request.output,
            plan.procedure,
            plan.dut.serial,
            clock,
            head_of(plan, bench, clock),
        )
        outcome = Outcome(record.path)
        expected_s = procedure.duration_s(plan.parameters)
        with Progress(expected_s, quiet=request.quiet) as progress:
            progress.say(f"{procedure.title}: {plan.dut.model} {plan.dut.serial}")
            progress.say(f"bench {bench.name}, {how_long(expected_s, clock)}")
            progress.say(f"recorded in {record.path}")
            record.event(RUN_STARTED, **what_is_planned(plan, procedure, clock))
            for one in warned:
                progress.say(f"WARNING: {one.sentence}")
                record.event(one.kind, message=one.sentence)
            watch_system_clock(record, clock)
            run = Run(plan, bench, clock, record, progress, operator)
            trace = Trace(record.path, clock) if request.trace else None
            _walk(run, procedure, session.addresses, outcome, trace)
    with wishes_held():
        with suppress(RecordError):  # a full disk was told when the run met it
            note_end(record)
        _evaluate(record, outcome, report=request.report)
        record.seal()
        if request.report and outcome.error is None and not record.faults:
            _export(record)  # not on a disk that is full: the HDF5 library crashes there
    if record.faults and outcome.exit_code not in (EXIT_ABORTED, EXIT_INTERLOCK):
        outcome.error = outcome.error or f"not everything was recorded: {record.faults[0]}"
        outcome.exit_code = EXIT_FAULT
    return outcome


def note_end(record: RunRecord) -> None:
    """Add to run.json when the run ended."""
    facts = json.loads((record.path / RUN).read_text(encoding="utf-8"))
    record.write_json(RUN, {**facts, "ended_utc": utc_now().isoformat(timespec="seconds")})


def all_prompts(procedure: Procedure, plan: Plan, bench: Bench) -> list[Prompt]:
    """Return every prompt a run may show: the procedure's own and those of its drivers."""
    prompts = list(procedure.prompts(plan.parameters))
    for name in procedure.instruments(plan.parameters):
        if name in bench.instruments:
            driver = registry.load(registry.DRIVERS, bench.instruments[name].driver)
            asked: Mapping[str, str] = getattr(driver, "prompts", {})
            prompts.extend(Prompt(prompt_id, text) for prompt_id, text in asked.items())
    return prompts


def head_of(plan: Plan, bench: Bench, clock: Clock) -> dict[str, str]:
    """Return the files that say what a run is asked to do; they stand before it does anything."""
    facts: dict[str, Any] = {
        "started_utc": utc_now().isoformat(timespec="seconds"),
        "clock": type(clock).__name__,
        "system_clock_synchronised": system_clock_synchronised(),
        "set": list(plan.overrides),
        **versions(),
    }
    return {
        "plan.yaml": plan.text,
        "bench.yaml": bench.text,
        "plan.resolved.yaml": resolved_text(plan),
        "bench.resolved.yaml": yaml_text(bench.to_yaml_data()),
        RUN: json_text(facts),
    }


def _walk(
    run: Run,
    procedure: Procedure,
    addresses: Mapping[str, str],
    outcome: Outcome,
    trace: Trace | None,
) -> None:
    """Open the bench, do every step, and bring the bench to rest; the outcome says how it went."""
    found: dict[str, Found] = {}
    with run.clock.participant("run"), AbortSignals(run.clock) as signals:
        try:
            needed = procedure.instruments(run.parameters)
            found = open_instruments(run.bench, needed, addresses, run.clock, run.ask, trace)
            run.instruments = {name: one.instrument for name, one in found.items()}
            for name, one in found.items():
                run.record.event("identified", instrument=name, **vars(one.identity))
            for step in procedure.steps:
                run.do(step)
            outcome.exit_code = 0
        except StationError as error:
            _failed(run, outcome, error, error.exit_code)
        except Exception as error:  # a bug in a step must still leave a safe bench
            _failed(run, outcome, error, EXIT_FAULT)
        finally:
            signals.hold()
            outcome.safe = make_bench_safe(run.instruments, run.bench.safe_order(), run.clock)
            run.record.note("safe-state", outcomes=[one.to_data() for one in outcome.safe])
            for one in found.values():
                with suppress(Exception):  # a line that is gone keeps no other from being closed
                    one.instrument.close()
            if trace is not None:
                trace.close()
            run.record.note("run-ended", complete=outcome.error is None)
            run.record.close()
    if outcome.unsafe:
        outcome.exit_code = EXIT_FAULT


def _failed(run: Run, outcome: Outcome, error: Exception, exit_code: int) -> None:
    known = isinstance(error, StationError | ClockError)
    outcome.error = str(error) if known else f"a fault of the program: {error!r}"
    outcome.exit_code = exit_code
    trace = "".join(traceback.format_exception(error))
    run.record.note("failed", message=outcome.error, exit_code=exit_code, traceback=trace)


def _export(record: RunRecord) -> None:
    """Leave the raw data as HDF5 for other tools; what cannot be exported now can be later."""
    from station.exporting.hdf5 import export_hdf5

    try:
        export_hdf5(RunFolder(record.path), record.path / EXPORTS / f"{record.path.name}.h5")
    except Exception as error:  # the record itself is complete without it
        tell(f"not exported: {error}; `station export` does it again")


def _evaluate(record: RunRecord, outcome: Outcome, *, report: bool) -> None:
    """Analyse a run that went through its steps, from what is on disk."""
    if outcome.error is not None:
        return
    try:
        outcome.document = conclude_run(record.path, report=report)
    except Exception as error:  # what was measured is on disk, whatever the evaluation does
        outcome.error = (
            f"the data are complete, their evaluation failed: {error!r}; "
            f"run `station analyse {record.path}` to see where"
        )
        outcome.exit_code = EXIT_FAULT
        return
    if outcome.exit_code == 0:
        outcome.exit_code = exit_code_of(outcome.document)
