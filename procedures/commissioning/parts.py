"""What a part of a commissioning is: a few checks of one kind, which a plan may leave out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from station.method.dry_run import DryRun
from station.procedure import (
    LazyImport,
    Problem,
    RecordUse,
    ResultKind,
    Step,
    every_axis,
    no_lines,
    no_problem,
    no_records,
)

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def all_tried(parameters: Any) -> Mapping[str, str]:
    """Return that every step does all that it can."""
    return {}


@dataclass(frozen=True)
class Part:
    """Checks of one kind. All but `fits` get the part's own parameters, `parameters.<name>`.

    results: name to axes and unit of its figures; records, check: as in `Procedure`, for these
    steps alone; findings(folder, parameters, bench): the figures and
    causes of a record; is_possible(bench): whether a bench has the instruments for it;
    fits(bench): overrides by which `station commission` fits the plan to a bench;
    drift: results that a weekly check watches, to what they may change, in their units;
    short: overrides by which the check takes less time;
    completes(findings, bench): values of the bench file that were measured;
    measured_axes: as in `Procedure`, for these figures alone;
    may_stand: causes of its own that keep no figure from being written;
    touches: whether its causes may falsify what other parts measure with the same instruments;
    not_tried: by step number, why a step does nothing with these parameters, or a part of it.
    """

    name: str
    steps: tuple[Step, ...]
    results: Mapping[str, ResultKind]
    findings: LazyImport
    is_possible: Callable[[Bench], bool]
    records: Callable[[Any, Bench], tuple[RecordUse, ...]] = no_records
    check: Callable[[Any, Bench], Iterator[Problem]] = no_problem
    fits: Callable[[Bench], Iterable[str]] = no_lines
    drift: Mapping[str, float] = field(default_factory=dict)
    short: tuple[str, ...] = ()
    completes: LazyImport | None = None
    measured_axes: Callable[[Any], Mapping[str, tuple[str, ...]]] = every_axis
    may_stand: frozenset[str] = frozenset()
    touches: bool = True
    not_tried: Callable[[Any], Mapping[str, str]] = all_tried

    def instruments(self, parameters: Any) -> tuple[str, ...]:
        """Return the bench instances that the steps use, by the parameters of a commissioning."""
        return DryRun(parameters).walk(self.steps).instruments
