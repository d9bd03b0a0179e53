"""The results of a run as a workbook (XLSX): every number is a number, and no text a formula."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

from station.report.run_report import context_of_run
from station.report.tables import COLUMNS, clean, rows_of

if TYPE_CHECKING:
    from openpyxl.worksheet.worksheet import Worksheet

    from station.record.folder import RunFolder
    from station.results import ResultDocument

RESULT_COLUMNS = (*COLUMNS, "guard_band", "conformity_probability", "holds_at", "terms")
BUDGET_COLUMNS = (
    "name",
    "axis",
    "quantity",
    "description",
    "type",
    "value",
    "standard_uncertainty",
    "unit",
    "distribution",
    "degrees_of_freedom",
    "sensitivity",
    "contribution",
    "share",
    "source",
)
INSTRUMENT_COLUMNS = (
    "name",
    "role",
    "model",
    "serial",
    "firmware",
    "certificate",
    "due_date",
    "overdue",
)
MAX_WIDTH = 60


def workbook_of(folder: RunFolder, document: ResultDocument) -> bytes:
    """Return the results, budgets, covariance, flags, instruments and settings of a run as XLSX.

    Numbers have 16 significant digits, more than a spreadsheet reckons with; what is null is an
    empty cell.
    """
    from openpyxl import Workbook

    context = context_of_run(folder)
    book = Workbook()
    book.remove(book.active)
    head = (
        ("run", folder.path.resolve().name),
        ("procedure", document.procedure),
        ("verdict", document.verdict),
        ("decision_rule", context.decision_rule),
        ("started_utc", context.started_utc),
        ("ended_utc", context.ended_utc),
        ("operator", context.operator),
        ("plan", context.plan_name),
        ("bench", context.bench_name),
        ("simulated", context.simulated),
        ("head_of_log", context.head),
        *((f"device_{name}", text) for name, text in context.dut.items()),
        *context.references,
        *context.versions,
    )
    sheets: Sequence[tuple[str, Sequence[Any], Iterable[Sequence[Any]]]] = (
        ("Run", ("what", "value"), head),
        ("Results", RESULT_COLUMNS, _results(document)),
        ("Budgets", BUDGET_COLUMNS, _budgets(document)),
        ("Covariance", *_covariance(document)),
        ("Flags", ("code", "axis", "message"), _flags(document)),
        ("Instruments", INSTRUMENT_COLUMNS, _columns(context.instruments, INSTRUMENT_COLUMNS)),
        ("Settings", ("parameter", "value"), context.parameters),
    )
    for title, columns, rows in sheets:
        _fill(book.create_sheet(title), columns, rows)
    data = io.BytesIO()
    book.save(data)
    return data.getvalue()


def _results(document: ResultDocument) -> Iterable[Sequence[Any]]:
    for row, result in zip(rows_of(document), document.results, strict=True):
        estimate = result.estimate
        terms = estimate.measures if estimate.extra.get("terms") else None
        more = {"holds_at": estimate.holds_at or None, "terms": terms}
        yield [{**row, **more}.get(name) for name in RESULT_COLUMNS]


def _budgets(document: ResultDocument) -> Iterable[Sequence[Any]]:
    for result in document.results:
        of = {"name": result.estimate.name, "axis": result.estimate.axis}
        for line in result.budget:
            yield [{**line.to_data(), **of}[name] for name in BUDGET_COLUMNS]


def _covariance(document: ResultDocument) -> tuple[Sequence[Any], Iterable[Sequence[Any]]]:
    """Return the head of the matrix and its rows, each with the name of its result."""
    related = document.covariance
    if related is None:
        return ("result",), ()
    names = [" ".join(filter(None, key)) for key in related.keys]
    rows = [[name, *row] for name, row in zip(names, related.matrix, strict=True)]
    return ["result", *names], rows


def _flags(document: ResultDocument) -> Iterable[Sequence[Any]]:
    return ((flag.code, flag.axis, flag.message) for flag in document.flags)


def _columns(rows: Iterable[object], names: Sequence[str]) -> Iterable[Sequence[Any]]:
    return ([getattr(row, name) for name in names] for row in rows)


def _fill(sheet: Worksheet, columns: Sequence[Any], rows: Iterable[Sequence[Any]]) -> None:
    """Write a head and rows; the head stays in view, and the columns are as wide as their texts."""
    from openpyxl.styles import Font
    from openpyxl.utils import get_column_letter

    widths = [0] * len(columns)
    for number, row in enumerate(chain([columns], rows), start=1):
        for index, value in enumerate(row):
            shown = _cell_value(value)
            if shown is None:
                continue
            cell = sheet.cell(number, index + 1, shown)
            if isinstance(shown, str):
                cell.data_type = "s"  # a text that begins with = is no formula
            if number == 1:
                cell.font = Font(bold=True)
            widths[index] = max(widths[index], min(len(str(shown)) + 2, MAX_WIDTH))
    for index, width in enumerate(widths, start=1):
        sheet.column_dimensions[get_column_letter(index)].width = width
    sheet.freeze_panes = "A2"


def _cell_value(value: Any) -> bool | int | float | str | None:
    """Return what a cell can hold; a number that is not finite leaves it empty."""
    if value is None or value == "":
        return None
    if isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        return value if math.isfinite(value) else None
    return clean(value)
