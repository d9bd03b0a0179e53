"""The report of an imported dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.findings import Findings
from station.procedure import procedure_of
from station.record.versions import versions
from station.report.context import ReportContext
from station.report.drawing import parts_of
from station.report.html import render_html
from station.report.run_report import flat_rows, version_rows
from station.results import ResultDocument

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset


def report_of_dataset(raw: RawDataset, document: ResultDocument, findings: Findings) -> str:
    """Return the report of an imported dataset as one HTML page."""
    procedure = procedure_of(raw.procedure)
    context = ReportContext(
        title=procedure.title,
        source=procedure.source,
        subject=f"imported dataset {raw.folder.name}",
        parameters=tuple(flat_rows(raw.document.data["conditions"])),
        assumptions=(
            "The data were imported: no calibration records came with them, so the uncertainties "
            "hold type A and what the conditions state, no more.",
            *procedure.assumptions,
        ),
        versions=tuple(version_rows(versions())),
        reproduce=f"station analyse {raw.folder.name}",
    )
    return render_html(document, context, parts_of(procedure, findings, document))
