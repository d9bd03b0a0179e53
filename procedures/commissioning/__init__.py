"""Commissioning: what a bench does, before a method relies on it; a part for each kind of check."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from station.errors import InputError
from station.method.run import Run
from station.procedure import (
    LazyImport,
    Problem,
    Procedure,
    RecordUse,
    ResultKind,
    Step,
    usual_modules,
)
from station.safety.drift import DRIFT

from . import (
    chamber,
    clocks,
    coils,
    contacts,
    gyro,
    lines,
    motion,
    pick_up,
    probe,
    stage,
    supplies,
)
from .drift import drift_axes, unlike
from .lines import records_of_asked
from .parameters import CommissioningParameters
from .part import CAUSES, Part

if TYPE_CHECKING:
    from station.instruments.bench import Bench

PARTS: tuple[Part, ...] = tuple(
    module.PART
    for module in (
        contacts,
        lines,
        supplies,
        coils,
        probe,
        pick_up,
        motion,
        stage,
        gyro,
        chamber,
        clocks,
    )
)
"""In the order in which they are walked."""
WATCHED = tuple(name for part in PARTS for name in part.drift)
"""Figures that may drift, which a check holds against those of the commissioning."""

CHECKS, WATCH = "parameters.checks", ("parameters", "watch")


def chosen(parameters: CommissioningParameters) -> Iterator[tuple[Part, Any]]:
    """Yield the parts that a plan asks for, each with its own parameters."""
    for part in PARTS:
        if part.name in parameters.checks:
            yield part, part.own(parameters)


def records(parameters: CommissioningParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analyses take of calibration records."""
    uses = [use for part, own in chosen(parameters) for use in part.records(own, bench)]
    used = {part.name: part.instruments(parameters) for part, _ in chosen(parameters)}
    asking = {lines.PART.name, clocks.PART.name}
    measured = {name for part, names in used.items() if part not in asking for name in names}
    asked = dict.fromkeys(name for part in asking & set(used) for name in used[part])
    only_asked = [name for name in asked if name not in measured]
    return (*uses, *records_of_asked(only_asked, bench))


def check(parameters: CommissioningParameters, bench: Bench) -> Iterator[Problem]:
    """Yield why a part cannot be done on a bench, or a bench not be checked."""
    if parameters.watch and bench.commissioned is None:
        yield Problem(
            WATCH,
            "the bench file holds no figures of a commissioning; run `station commission` first "
            "and use the bench file that it leaves",
        )
    elif parameters.watch and bench.commissioned is not None:
        units = {name: kind.unit for name, kind in PROCEDURE.results.items()}
        yield from (Problem(WATCH, reason) for reason in unlike(bench.commissioned, units))
    for part, own in chosen(parameters):
        yield from part.check(own, bench)


def measured_axes(parameters: CommissioningParameters) -> dict[str, tuple[str, ...]]:
    """Return no axes for the results of parts that a plan leaves out, and what it watches."""
    left_out = (part for part in PARTS if part.name not in parameters.checks)
    walks = list(chosen(parameters))
    return {
        **{name: () for part in left_out for name in part.results},
        **{name: axes for part, own in walks for name, axes in part.measured_axes(own).items()},
        DRIFT: drift_axes([part for part, _ in walks], parameters.watch),
    }


def fits(bench: Bench, short: bool, stated: Mapping[str, str]) -> Iterator[str]:
    """Yield what fits the shipped plan to a bench: its parts, the limits of these, their needs.

    Its short form has the parts whose figures the bench file holds, a limit for their drift, and
    none for a figure that would be watched and was not measured before. Parts that are `stated` in
    the place of these have theirs.
    """
    possible = wanted = [part for part in PARTS if part.is_possible(bench)]
    watched = WATCHED
    if bench.commissioned is not None:
        known = {figure.name for figure in bench.commissioned.figures}
        watched = tuple(name for name in WATCHED if name in known)
    if CHECKS in stated:
        wanted = [part for part in PARTS if part.name in re.findall(r"\w+", stated[CHECKS])]
    elif short:
        wanted = [part for part in possible if {*watched} & {*part.drift}]
    if short:
        names = [name for part in wanted for name in part.drift if name in watched]
        yield from (f"{'.'.join(WATCH)}=[{', '.join(names)}]", f"limits.{DRIFT}.max_abs=1")
    if not wanted and CHECKS not in stated:
        raise InputError(
            f"{bench.path}: nothing of this bench can be commissioned; a part needs, for one, "
            "three coils with their supplies and a gaussmeter"
            if not possible
            else f"{bench.path}: `commissioned` holds no figure that a check watches; commission "
            "the bench again"
        )
    yield f"{CHECKS}=[{', '.join(part.name for part in wanted)}]"
    for part in PARTS:
        if part not in wanted:
            yield from (f"limits.{name}=null" for name in part.results)
        elif part in possible:
            yield from part.fits(bench)
            if short:
                yield from part.short
                yield from (f"limits.{name}=null" for name in part.drift if name not in watched)


def steps() -> Iterator[Step]:
    """Yield the steps of all parts; one that a plan leaves out does nothing."""
    for part in PARTS:
        for step in part.steps:
            yield Step(step.number, step.title, _where_chosen(part, step))


def _where_chosen(part: Part, step: Step) -> Callable[[Run], None]:
    def body(run: Run) -> None:
        if part.name in run.parameters.checks:
            step.body(run)

    return body


PROCEDURE = Procedure(
    name="commissioning",
    title="Commissioning of a bench, before a method relies on it",
    source="Inertial Station (no published method)",
    parameters=CommissioningParameters,
    results={
        **{name: kind for part in PARTS for name, kind in part.results.items()},
        CAUSES: ResultKind((), "1"),
        DRIFT: ResultKind(drift_axes(PARTS, WATCHED), "1"),
    },
    steps=tuple(steps()),
    records=records,
    check=check,
    **usual_modules(__name__),
    measured_axes=measured_axes,
    fits=fits,
    files=LazyImport(f"{__name__}.evaluate:files_of_run"),
    assumptions=(
        "The probe's axes stand along the coils' as its prompt asks: a probe turned by a small "
        "angle shows as a part across the axes of all coils.",
        "A reversed coil and a reversed axis of the probe differ only by the ambient field that "
        "the plan states; two exchanged coils and two exchanged axes of the probe only where the "
        "coil constants differ.",
    ),
)
