"""What a procedure is: parameters, roles, and the published method's steps in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import InitVar, dataclass
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypedDict

from station import registry
from station.errors import InputError
from station.files.faults import FaultList
from station.findings import of_numbers
from station.method.dry_run import DryRun, Forecast, Walk
from station.method.duration import Duration
from station.method.prompts import Prompt as Prompt
from station.method.run import EarlierProgress
from station.method.run import Step as Step

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.fields import StrictModel
    from station.findings import Findings
    from station.instruments.bench import Bench
    from station.parts import Part
    from station.record.folder import RunFolder
    from station.record.integrity import FolderState
    from station.results import ResultDocument


@dataclass(frozen=True)
class ResultKind:
    """A result's axes and unit, as the contract of the procedure states them."""

    axes: tuple[str, ...]
    unit: str


@dataclass(frozen=True)
class Problem:
    """A fault of a plan, or of a plan on a bench: where in the plan, what, and what would do."""

    where: tuple[str, ...]
    what: str


@dataclass(frozen=True)
class RecordUse:
    """What an analysis takes of an instrument's calibration record, for one quantity.

    The budget takes the uncertainty at the value `at` (in `unit`); without a record that states it
    the results are `uncalibrated`, unless it is not `needed`. `in_budget` and `corrected` say
    whether uncertainty and correction are taken at all: what is stated beyond that is named.
    """

    instrument: str
    quantity: str
    at: float
    unit: str
    in_budget: bool = True
    needed: bool = True
    corrected: bool = True


@dataclass(frozen=True)
class LazyImport:
    """Something of a module that is imported when it is asked for, not before: `lab.fit:analyse`.

    Called, it calls what stands there; `get` returns it.
    """

    name: str

    def get(self) -> Any:
        """Return it; raises ImportError or AttributeError where there is no such thing."""
        return resolve_name(self.name)

    def __call__(self, *arguments: Any) -> Any:
        """Call it."""
        return self.get()(*arguments)


class DataHooks(TypedDict, total=False):
    """What a procedure does with data once they are there."""

    evaluate_run: Callable[[RunFolder, Any, Bench], Findings]
    evaluate_dataset: Callable[[RawDataset], Findings]
    conditions: Callable[[], type[StrictModel]]
    report: Callable[[Findings, ResultDocument], Sequence[Part]]


def usual_modules(package: str) -> DataHooks:
    """Return the hooks of a package whose modules have the usual names, imported when used.

    `evaluate` has `findings_of_run(folder, parameters, bench)`. Where there is a module
    `from_import`, with the model `Conditions`, `evaluate` has `findings_of_dataset(raw)`, too;
    where there is `figures`, it has `draw_parts(findings, document)`.
    """
    hooks = DataHooks(evaluate_run=LazyImport(f"{package}.evaluate:findings_of_run"))
    if find_spec(f"{package}.from_import") is not None:
        hooks["evaluate_dataset"] = LazyImport(f"{package}.evaluate:findings_of_dataset")
        hooks["conditions"] = LazyImport(f"{package}.from_import:Conditions").get
    if find_spec(f"{package}.figures") is not None:
        hooks["report"] = LazyImport(f"{package}.figures:draw_parts")
    return hooks


def no_problem(parameters: Any, bench: Bench) -> Iterator[Problem]:
    """Yield nothing: any bench with the instruments and limits that the work needs will do."""
    return iter(())


def no_dataset(raw: RawDataset) -> Findings:
    """Refuse a dataset, for a procedure that evaluates its own runs only."""
    where = ("procedure",)
    what = "evaluates its own runs only, no data that were recorded elsewhere"
    raise FaultList([raw.document.fault(where, what)])


def no_parts(findings: Findings, document: ResultDocument) -> Sequence[Part]:
    """Return nothing: the report shows what it shows of every procedure."""
    return ()


def everything(parameters: Any, bench: Bench) -> int | None:
    """Return None: the evaluation holds all rows at once."""
    return None


def every_axis(parameters: Any) -> Mapping[str, tuple[str, ...]]:
    """Return nothing: a run measures every axis of every result, and needs a limit for none."""
    return {}


def no_lines(*of: Any) -> Sequence[str]:
    """Return nothing: every plan determines the same quantities, or fits every bench."""
    return ()


def nothing_undetermined(parameters: Any) -> Mapping[str, str]:
    """Return nothing, for a procedure whose every plan determines all of its results alone."""
    return {}


def no_inputs(parameters: Any) -> Mapping[str, Path]:
    """Return nothing: plan and bench are all that a run is given."""
    return {}


def no_files(findings: Findings, document: ResultDocument) -> Mapping[str, str]:
    """Return nothing: results and report are all that the procedure leaves."""
    return {}


def no_records(parameters: Any, bench: Bench) -> tuple[RecordUse, ...]:
    """Return nothing, for a procedure that takes nothing of any calibration record."""
    return ()


INTERFACE = 2
"""The version of what a package of procedures is written against; see `docs/extending.md`."""
OLD_FORM = (
    "{} is written for interface 1, which declares `work`, `instruments` and `prompts`; this is "
    f"interface {INTERFACE}: leave the three out and write steps that a dry run can walk, as in "
    "docs/how-to/write-a-procedure.md"
)


@dataclass(frozen=True)
class Procedure:
    """A published method, ready to be run, imported and analysed.

    What needs NumPy or a plotting library, as evaluation and report do, is given as `LazyImport` or
    by `usual_modules`, so that a plan is validated without them.

    parameters: model of the plan's `parameters`; results: name to axes and unit;
    steps: what is commanded, asked and recorded, in order; a dry run walks them;
    records(parameters, bench): what its analysis takes of their calibration records;
    check(parameters, bench): the reasons of its own why this plan cannot run on this bench;
    missing instruments and set-points beyond a limit are checked for every procedure alike;
    evaluate_run / evaluate_dataset: recorded or imported data to findings;
    report(findings, document): plots and tables of its own;
    held_bytes(parameters, bench): the most of the record that the evaluation holds at once;
    inputs(parameters): files that the plan names, by their places in the run folder, where copies
    of them are kept and read from;
    files(findings, document): name to text of files beside the results, such as a compensation;
    outlook(parameters): in lines, what a plan determines and how well, before anything moves;
    undetermined(parameters): results that a plan does not determine alone, each with a sentence;
    measured_axes(parameters): the axes of results that a plan may leave out;
    needs_limits(parameters): the results, with their axes, that a plan ends by deciding;
    fits(bench, short, stated): overrides that fit its shipped plan to a bench, beside stated ones;
    assumptions: what its numbers do not say;
    conditions(): model of an imported dataset's `conditions`, for the JSON Schema.
    """

    name: str
    title: str
    source: str
    parameters: type[StrictModel]
    results: Mapping[str, ResultKind]
    steps: Sequence[Step]
    evaluate_run: Callable[[RunFolder, Any, Bench], Findings]
    evaluate_dataset: Callable[[RawDataset], Findings] = no_dataset
    report: Callable[[Findings, ResultDocument], Sequence[Part]] = no_parts
    check: Callable[[Any, Bench], Iterator[Problem]] = no_problem
    records: Callable[[Any, Bench], tuple[RecordUse, ...]] = no_records
    held_bytes: Callable[[Any, Bench], int | None] = everything
    outlook: Callable[[Any], Sequence[str]] = no_lines
    undetermined: Callable[[Any], Mapping[str, str]] = nothing_undetermined
    inputs: Callable[[Any], Mapping[str, Path]] = no_inputs
    files: Callable[[Findings, ResultDocument], Mapping[str, str]] = no_files
    measured_axes: Callable[[Any], Mapping[str, tuple[str, ...]]] = every_axis
    needs_limits: Callable[[Any], Mapping[str, tuple[str, ...]]] = every_axis
    fits: Callable[[Bench, bool, Mapping[str, str]], Iterable[str]] = no_lines
    assumptions: tuple[str, ...] = ()
    conditions: Callable[[], type[StrictModel]] | None = None
    work: InitVar[Any] = None
    instruments: InitVar[Any] = None
    prompts: InitVar[Any] = None

    def __post_init__(self, *old: Any) -> None:
        """Refuse the form of interface 1; raises InputError."""
        if any(value is not None for value in old):
            raise InputError(OLD_FORM.format(self.name))

    def step(self, number: str) -> Step:
        """Return the step with the source document's number."""
        for step in self.steps:
            if step.number == number:
                return step
        raise InputError(f"{self.name} has no step {number}")

    def walk(self, parameters: Any, past: EarlierProgress | None = None) -> Walk:
        """Return what a dry run of a plan finds: a whole one, or what is left of an earlier one.

        Raises InputError where a step cannot be walked without a bench.
        """
        try:
            return DryRun(parameters, past).walk(self.steps)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from error

    def units(self, parameters: Any) -> tuple[str, ...]:
        """Return the units of work that a run of the plan will finish, in order."""
        return self.walk(parameters).units

    def damage_of(self, folder: RunFolder, parameters: Any) -> FolderState:
        """Return what is damaged of a run; what an instrument read that is optional spoils no unit.

        A bench may lack such an instrument, so no value is made of what it read.
        """
        damage = folder.damage
        optional = {name for name, _ in self.walk(parameters).optional} if damage.parts else set()
        return damage.sparing(optional)

    def forecast(self, parameters: Any, bench: Bench) -> Forecast:
        """Return what a run will command and record; opens nothing."""
        walk, held_bytes = self.walk(parameters), self.held_bytes(parameters, bench)
        return Forecast(walk.set_points(bench), walk.recordings(bench), held_bytes)

    def timed_steps(self, parameters: Any) -> Iterator[tuple[Step, Duration]]:
        """Yield each step with the bench time that it takes; what a person does is beside."""
        walk = self.walk(parameters)
        for step in self.steps:
            yield step, walk.duration(step.number)

    def duration(self, parameters: Any) -> Duration:
        """Return the bench time that a run takes."""
        return self.walk(parameters).duration()


def procedure_of(name: str) -> Procedure:
    """Return the procedure that a package offers under a name; raises InputError."""
    loaded: Procedure = registry.load(registry.PROCEDURES, name)
    return loaded


class Procedures(Mapping[str, Procedure]):
    """All procedures; each is loaded when it is asked for."""

    def __iter__(self) -> Iterator[str]:
        return iter(registry.names(registry.PROCEDURES))

    def __len__(self) -> int:
        return len(registry.names(registry.PROCEDURES))

    def __contains__(self, name: object) -> bool:
        return name in registry.names(registry.PROCEDURES)

    def __getitem__(self, name: str) -> Procedure:
        if name not in self:
            raise KeyError(name)
        return procedure_of(name)


def check_findings(procedure: Procedure, findings: Findings) -> Findings:
    """Return findings; InputError for an estimate that the procedure does not declare so.

    A limit of the plan is converted to the declared unit, and compared with the estimate's number.
    One that is no number is undetermined, and flagged.
    """
    for estimate in findings.estimates:
        declared = procedure.results.get(estimate.name)
        if declared is None:
            raise InputError(
                f"the evaluation gives {estimate.name}, and the `results` of {procedure.name} name "
                f"{', '.join(procedure.results)}"
            )
        if declared.unit != estimate.unit:
            raise InputError(
                f"the evaluation gives {estimate.name} in {estimate.unit}, its procedure declares "
                f"{declared.unit}; convert it in the evaluation"
            )
    return of_numbers(findings)
