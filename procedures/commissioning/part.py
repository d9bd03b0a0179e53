"""What a part of a commissioning is: checks of one kind, with a table of its figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from station.errors import InstrumentError
from station.findings import Analysis, Estimate, Findings, Flag, InputQuantity, findings_of
from station.method.dry_run import DryRun
from station.method.duration import on_the_way
from station.procedure import (
    Problem,
    Prompt,
    RecordUse,
    ResultKind,
    Step,
    every_axis,
    no_lines,
    no_problem,
    no_records,
)
from station.roles import DirectCurrentSupply, MadeSafe, RotaryStage, Turntable

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.method.run import Run
    from station.record.folder import RunFolder

    from .completing import Completion

COILS = AXES = ("x", "y", "z")
CAUSES, NOT_MEASURED = "named_causes", "not-measured"
UNDECIDED = "-undecided"
"""The end of the codes of what the data do not decide; the figure beside it says so, too."""
WITHIN_S, USUALLY_S = 30.0, 1.0
"""In which what turns or carries a current is brought to rest before a hand is asked for."""
COVERAGE = 2.0
"""Standard uncertainties by which a figure must be beyond its limit to be named as a cause."""


@dataclass(frozen=True)
class Cause:
    """What likely is wrong where a figure is off: a code, and a sentence.

    In the sentence stand `{value}` and `{u}` of the figure, `{off}` from its nominal, and `{axis}`.
    """

    code: str
    sentence: str


@dataclass(frozen=True)
class Figure:
    """A figure that a part measures, for each of its axes.

    limit: how far it may be from `nominal`, in its unit; infinite for what is only said.
    drift: how far it may change before the next check; None for what is not watched.
    cause: what is wrong beyond the limit, where the figure alone decides it.
    """

    name: str
    unit: str = "1"
    axes: tuple[str, ...] = ()
    limit: float = math.inf
    nominal: float = 0.0
    drift: float | None = None
    cause: Cause | None = None

    def measured(
        self,
        value: float,
        u: float,
        method: str,
        axis: str | None = None,
        freedom: float | None = None,
        by: Mapping[str, float] | None = None,
        **extra: Any,
    ) -> Estimate:
        """Return the figure as it was measured; `by`: its sensitivities to type B inputs."""
        return Estimate(self.name, axis, value, self.unit, u, freedom, method, by or {}, extra)

    def undetermined(self, why: str = "", axis: str | None = None) -> Estimate:
        """Return that the record does not determine the figure."""
        return Estimate(self.name, axis, None, self.unit, None, None, why)

    def is_off(self, value: float, u: float) -> bool:
        """Return whether a value is beyond the limit by more than its uncertainty."""
        return abs(value - self.nominal) - COVERAGE * u > self.limit


def undetermined(
    figures: Iterable[Figure],
    why: str = "",
    axes: Mapping[str, tuple[str, ...]] | None = None,
) -> list[Estimate]:
    """Return that a record determines none of some figures; `axes`: those that it is about."""
    of = axes or {}
    return [
        figure.undetermined(why, axis)
        for figure in figures
        for axis in of.get(figure.name, figure.axes or (None,))
    ]


def combined_u(estimate: Estimate, inputs: Sequence[InputQuantity]) -> float:
    """Return the standard uncertainty of a figure, with that of the type B inputs."""
    known = {quantity.name: quantity.standard_uncertainty or 0.0 for quantity in inputs}
    parts = (by * known.get(name, 0.0) for name, by in estimate.sensitivities.items())
    return math.hypot(estimate.standard_uncertainty or 0.0, *parts)


def causes_of(
    figures: Iterable[Figure], estimates: Sequence[Estimate], inputs: Sequence[InputQuantity]
) -> Iterator[Flag]:
    """Yield the cause of each figure that is off, by the table of figures."""
    for figure in figures:
        for estimate in estimates:
            if estimate.name != figure.name or estimate.value is None or figure.cause is None:
                continue
            u = combined_u(estimate, inputs)
            if figure.is_off(estimate.value, u):
                said = {"value": estimate.value, "off": estimate.value - figure.nominal, "u": u}
                sentence = figure.cause.sentence.format(axis=estimate.axis, **said)
                yield Flag(figure.cause.code, sentence, estimate.axis)


def no_inputs(parameters: Any, bench: Bench) -> Sequence[InputQuantity]:
    """Return that the figures are sensitive to no type B input."""
    return ()


def nothing_completed(findings: Findings, bench: Bench) -> Iterable[Completion]:
    """Return that no value of the bench file was measured."""
    return ()


def always(bench: Bench) -> bool:
    """Return that nothing else is needed of a bench."""
    return True


def all_tried(parameters: Any) -> Mapping[str, str]:
    """Return that every step does all that it can."""
    return {}


@dataclass(frozen=True)
class Part:
    """Checks of one kind. All but `fits` get the part's own parameters, `parameters.<name>`.

    figures: the table of what is measured, from which results, flags, drift, checklist and the
    limits of the shipped plan follow.
    units: the units of work that the figures need, all of them; without them none is determined.
    dataset: what was recorded, as the analysis takes it; inputs: the type B inputs of the figures.
    analyse: the figures, and the causes that no figure decides alone; it gets dataset and inputs.
    needs: the bench's instruments without which there is nothing of this kind to check;
    has: what else a bench must have.
    records, check: as in `Procedure`, for these steps alone.
    fits: overrides by which `station commission` fits the plan to a bench.
    short: overrides by which the check takes less time.
    completes: values of the bench file that were measured.
    measured_axes: as in `Procedure`, for these figures alone.
    may_stand: causes of its own that keep no figure from being written.
    touches: whether its causes may falsify what other parts measure with the same instruments.
    not_tried: by step number, why a step does nothing with these parameters, or a part of it.
    site: the plan's key that states what the part takes of the site.
    """

    name: str
    steps: tuple[Step, ...]
    figures: tuple[Figure, ...]
    units: Callable[[Any], Iterable[str]]
    dataset: Callable[[RunFolder, Any, Bench], Any]
    analyse: Callable[[Any, Sequence[InputQuantity]], Analysis]
    needs: tuple[str, ...]
    has: Callable[[Bench], bool] = always
    inputs: Callable[[Any, Bench], Sequence[InputQuantity]] = no_inputs
    records: Callable[[Any, Bench], tuple[RecordUse, ...]] = no_records
    check: Callable[[Any, Bench], Iterator[Problem]] = no_problem
    fits: Callable[[Bench], Iterable[str]] = no_lines
    short: tuple[str, ...] = ()
    completes: Callable[[Findings, Bench], Iterable[Completion]] | None = None
    measured_axes: Callable[[Any], Mapping[str, tuple[str, ...]]] = every_axis
    may_stand: frozenset[str] = frozenset()
    touches: bool = True
    not_tried: Callable[[Any], Mapping[str, str]] = all_tried
    site: str = ""
    results: Mapping[str, ResultKind] = field(init=False)
    drift: Mapping[str, float] = field(init=False)

    def __post_init__(self) -> None:
        results = {figure.name: ResultKind(figure.axes, figure.unit) for figure in self.figures}
        drift = {figure.name: figure.drift for figure in self.figures if figure.drift is not None}
        object.__setattr__(self, "results", results)
        object.__setattr__(self, "drift", drift)

    def own(self, parameters: Any) -> Any:
        """Return the part's own parameters, with what it takes of the site as an attribute."""
        stated = {self.site: getattr(parameters, self.site)} if self.site else {}
        return getattr(parameters, self.name).model_copy(update=stated)

    def is_possible(self, bench: Bench) -> bool:
        """Return whether a bench has what the part needs."""
        return all(name in bench.instruments for name in self.needs) and self.has(bench)

    def instruments(self, parameters: Any) -> tuple[str, ...]:
        """Return the bench instances that the steps use, by the parameters of a commissioning."""
        return DryRun(parameters).walk(self.steps).instruments

    def findings(self, folder: RunFolder, parameters: Any, bench: Bench) -> Findings:
        """Return figures and causes of a run; without all its records there is no figure."""
        finished = folder.finished_units()
        if missing := [unit for unit in self.units(parameters) if unit not in finished]:
            return findings_of(self._not_measured(parameters, missing), None, [])
        data, inputs = self.dataset(folder, parameters, bench), self.inputs(parameters, bench)
        analysis = self.analyse(data, inputs)
        causes = causes_of(self.figures, analysis.estimates, inputs)
        whole = replace(analysis, flags=[*analysis.flags, *causes])
        return findings_of(whole, data, inputs)

    def _not_measured(self, parameters: Any, missing: Sequence[str]) -> Analysis:
        estimates = undetermined(self.figures, axes=self.measured_axes(parameters))
        names = [f"{estimate.name} {estimate.axis or ''}".strip() for estimate in estimates]
        message = (
            f"Not recorded: {', '.join(missing)}. The figures of the part {self.name} are "
            "determined together, or not at all."
        )
        details = {"units": list(missing), "coefficients": names}
        return Analysis(estimates, (), (Flag("not-measured", message, details=details),))


def ask_at_rest(run: Run, prompt: Prompt) -> None:
    """Make all that turns or carries a coil's current safe, then ask for a hand.

    Of the instruments that the run has opened. Raises InstrumentError where one is not safe: the
    person is not asked.
    """
    bring_to_rest(run)
    run.ask(prompt)


def bring_to_rest(run: Run) -> None:
    """Make all that turns or carries a coil's current safe; InstrumentError where one is not."""
    run.read(partial(make_all_safe, run), takes=on_the_way(USUALLY_S))


def make_all_safe(run: Run) -> None:
    """Make safe what the run has opened, one after the other, and read that back."""
    for name, instrument in run.instruments.items():
        if not isinstance(instrument, Turntable | RotaryStage | DirectCurrentSupply):
            continue
        harmful = run.role(name, MadeSafe)
        harmful.make_safe(run.now_s + WITHIN_S)
        reading = harmful.read_safety()
        if not reading.safe:
            raise InstrumentError(
                name,
                "bring it to rest before a person is asked for a hand",
                f"it reads back {reading.read_back}",
                "keep away from it and switch it off by hand",
            )
