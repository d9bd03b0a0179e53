"""From the record of a commissioning to its findings: those of all its parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from typing import TYPE_CHECKING, Any

from station.files.yaml.document import Document
from station.files.yaml.reading import read_yaml
from station.findings import NOT_TRIED, Estimate, Findings, Flag
from station.instruments.commissioned import Commissioned
from station.record.layout import BENCH_AS_WRITTEN

from . import PARTS, chosen
from .causes import coil_causes
from .coils import CoilAnalysis
from .completing import Completion, Withheld, confirmed_forms, figures_to_watch, files_of
from .drift import drifts, flags_of
from .lines import tried
from .parameters import CommissioningParameters
from .part import CAUSES, NOT_MEASURED, UNDECIDED, Part

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder
    from station.results import ResultDocument


@dataclass(frozen=True)
class CommissioningDetail:
    """What the parts found, by name; the bench file as written, its changes, its figures.

    `withheld`: the parts whose figures are not written, and the causes that are open. `left_out`:
    the parts that this bench could have and the plan leaves out.
    """

    parts: dict[str, Any]
    bench: str
    written: Document
    changes: tuple[Completion, ...]
    withheld: tuple[Withheld, ...]
    left_out: tuple[str, ...]
    commissioned: Commissioned | None


def findings_of_run(
    folder: RunFolder, parameters: CommissioningParameters, bench: Bench
) -> Findings:
    """Return the figures and causes of every part that was recorded, and what has drifted."""
    parts = [
        (part, with_causes(part.findings(folder, own, bench))) for part, own in chosen(parameters)
    ]
    estimates = [estimate for _, findings in parts for estimate in findings.estimates]
    flags = [flag for _, findings in parts for flag in findings.flags]
    estimates.append(named_causes(flags))
    untried = tuple(not_tried(parameters))
    if untried:
        message = f"Not tried: {'; '.join(untried)}."
        flags.append(Flag(NOT_TRIED, message, details={"checks": list(untried)}))
    open_causes = {part.name: causes_touching(part, parts, parameters) for part, _ in parts}
    written = read_yaml(folder.path / BENCH_AS_WRITTEN)
    changes = tuple(
        change
        for part, findings in parts
        if part.completes is not None and not open_causes[part.name]
        for change in part.completes(findings, bench)
        if change.where in written.scalars
    )
    if parameters.watch and bench.commissioned is not None:
        limits = {name: limit for part, _ in parts for name, limit in part.drift.items()}
        allowed = {name: limits[name] for name in parameters.watch if name in limits}
        drifted = list(drifts(estimates, allowed, bench.commissioned))
        estimates += drifted
        flags += flags_of(drifted)
    began = date.fromisoformat(folder.run_facts()["started_utc"][:10])
    watched_names = [name for part, _ in parts if not open_causes[part.name] for name in part.drift]
    figures = figures_to_watch(estimates, watched_names, changes)
    writes = [part for part, _ in parts if part.drift or part.completes is not None]
    withheld = tuple(
        Withheld(part.name, tuple(codes)) for part in writes if (codes := open_causes[part.name])
    )
    commissioned = Commissioned(
        date=began,
        run=folder.path.name,
        figures=figures,
        confirmed=confirmed_forms(folder.events),
        tried=tuple(tried(folder)),
    )
    return Findings(
        estimates=estimates,
        published=[published for _, findings in parts for published in findings.published],
        flags=flags,
        inputs=[quantity for _, findings in parts for quantity in findings.inputs],
        detail=CommissioningDetail(
            {part.name: findings.detail for part, findings in parts},
            bench.name,
            written,
            changes,
            withheld,
            left_out(parameters, bench),
            None if parameters.watch else commissioned,
        ),
    )


def with_causes(findings: Findings) -> Findings:
    """Return the findings of a part with the causes that its figures decide together."""
    analysis = findings.detail.analysis
    if not isinstance(analysis, CoilAnalysis):
        return findings
    return replace(findings, flags=[*findings.flags, *coil_causes(analysis.measured)])


def named_causes(flags: Sequence[Flag]) -> Estimate:
    """Return the number of causes among the flags of all parts, with their codes.

    A cause may have no figure of its own that a limit could hold, such as a reversed accelerometer.
    """
    codes = [flag.code for flag in flags if not flag.code.endswith(UNDECIDED)]
    named = [code for code in codes if code not in (NOT_MEASURED, NOT_TRIED)]
    extra = {"codes": named}
    method = "causes that the parts name"
    return Estimate(CAUSES, None, float(len(named)), "1", 0.0, None, method, {}, extra)


def files_of_run(findings: Findings, document: ResultDocument) -> dict[str, str]:
    """Return the completed bench file and the figures, file name to text; a check leaves none."""
    detail: CommissioningDetail = findings.detail
    if detail.commissioned is None:
        return {}
    return files_of(
        detail.bench, detail.written, detail.changes, detail.withheld, detail.commissioned
    )


def left_out(parameters: CommissioningParameters, bench: Bench) -> tuple[str, ...]:
    """Return the parts that a bench could have and a plan leaves out; a check is short."""
    possible = [part.name for part in PARTS if part.is_possible(bench)]
    return () if parameters.watch else tuple({*possible} - {*parameters.checks})


def causes_touching(
    part: Part, parts: Sequence[tuple[Part, Findings]], parameters: CommissioningParameters
) -> list[str]:
    """Return the causes, named or undecided, that may falsify the figures of a part.

    Its own, and those of every part that measures with one of its instruments.
    """
    own = set(part.instruments(parameters))
    codes: dict[str, None] = {}
    for other, findings in parts:
        touches = other is part or (other.touches and own & set(other.instruments(parameters)))
        if touches:
            codes |= {f.code: None for f in findings.flags if f.code not in other.may_stand}
    return list(codes)


def not_tried(parameters: CommissioningParameters) -> Iterator[str]:
    """Yield what the parts of a plan could have tried and did not; a check is short."""
    for part, own in chosen(parameters):
        for step, why in part.not_tried(own).items() if not parameters.watch else ():
            yield f"{step}, {why}"
