"""From the record of a commissioning to its findings: those of all its parts."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING, Any

from station.files.yaml.document import Document
from station.files.yaml.reading import read_yaml
from station.findings import Findings
from station.instruments.commissioned import Commissioned
from station.record.layout import BENCH_AS_WRITTEN

from . import chosen
from .causes import named_causes
from .completing import Completion, confirmed_forms, figures_to_watch, files_of
from .drift import drifts, flags_of
from .parameters import CommissioningParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder
    from station.results import ResultDocument


@dataclass(frozen=True)
class CommissioningDetail:
    """What the parts found, by name; the bench file as written, its changes, its figures."""

    parts: dict[str, Any]
    bench: str
    written: Document
    changes: tuple[Completion, ...]
    commissioned: Commissioned | None


def findings_of_run(
    folder: RunFolder, parameters: CommissioningParameters, bench: Bench
) -> Findings:
    """Return the figures and causes of every part that was recorded, and what has drifted."""
    parts = [(part, part.findings(folder, own, bench)) for part, own in chosen(parameters)]
    estimates = [estimate for _, findings in parts for estimate in findings.estimates]
    flags = [flag for _, findings in parts for flag in findings.flags]
    estimates.append(named_causes(flags))
    written = read_yaml(folder.path / BENCH_AS_WRITTEN)
    changes = tuple(
        change
        for part, findings in parts
        if part.completes is not None
        for change in part.completes(findings, bench)
        if change.where in written.scalars
    )
    allowed = {name: limit for part, _ in parts for name, limit in part.drift.items()}
    if parameters.watch and bench.commissioned is not None:
        watched = list(drifts(estimates, allowed, bench.commissioned))
        estimates += watched
        flags += flags_of(watched)
    began = date.fromisoformat(folder.run_facts()["started_utc"][:10])
    figures = figures_to_watch(estimates, list(allowed), changes)
    commissioned = Commissioned(
        date=began,
        run=folder.path.name,
        figures=figures,
        confirmed=confirmed_forms(folder.events),
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
            None if parameters.watch else commissioned,
        ),
    )


def files_of_run(findings: Findings, document: ResultDocument) -> dict[str, str]:
    """Return the completed bench file and the figures, file name to text; a check leaves none."""
    detail: CommissioningDetail = findings.detail
    if detail.commissioned is None:
        return {}
    return files_of(detail.bench, detail.written, detail.changes, detail.commissioned)
