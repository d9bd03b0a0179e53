"""The results as a workbook, read back by openpyxl as another program would."""

from __future__ import annotations

import io
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from openpyxl import load_workbook

from station.cli.reporting import remake_report
from station.errors import InputError
from station.findings import Covariance
from station.record.events import head_of_run
from station.record.folder import RESULTS, RunFolder
from station.record.layout import EXPORTS
from station.report.revision import newest_revision
from station.report.workbook import workbook_of
from station.results import ResultDocument

DIGITS = 1e-15
"""A cell holds 16 significant digits."""

Sheets = dict[str, list[dict[str, Any]]]


@pytest.fixture(scope="module")
def run(two_axes_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("workbooks") / two_axes_run.name
    return Path(shutil.copytree(two_axes_run, place))


def read(data: bytes) -> Sheets:
    """Return the rows of each sheet by the names in its first row; no cell may be a formula."""
    book = load_workbook(io.BytesIO(data))
    sheets: Sheets = {}
    for sheet in book:
        assert all(cell.data_type != "f" for row in sheet for cell in row), sheet.title
        head, *rows = sheet.iter_rows(values_only=True)
        sheets[sheet.title] = [dict(zip(head, row, strict=True)) for row in rows]
    return sheets


def of(run: Path) -> Sheets:
    remake_report(run, "xlsx", "report")
    return read((run / EXPORTS / "results.xlsx").read_bytes())


def document_of(run: Path) -> ResultDocument:
    revision = newest_revision(RunFolder(run))
    assert revision is not None
    return revision.document


def test_results_and_budgets_are_the_numbers_of_the_results_file(run: Path) -> None:
    sheets = of(run)
    results = json.loads((run / RESULTS).read_text(encoding="utf-8"))["results"]
    for row, result in zip(sheets["Results"], results, strict=True):
        for name in ("value", "standard_uncertainty", "coverage_factor", "expanded_uncertainty"):
            assert row[name] == pytest.approx(result[name], rel=DIGITS), name
        assert row["degrees_of_freedom"] == pytest.approx(result["degrees_of_freedom"], rel=DIGITS)
        assert row["limit_max_abs"] == result["limit"]["max_abs"]
        assert (row["limit_min"], row["verdict"]) == (None, result["verdict"])
    lines = [
        (result["name"], result["axis"], line["quantity"], line["source"])
        for result in results
        for line in result["budget"]
    ]
    budgets = sheets["Budgets"]
    assert lines == [(row["name"], row["axis"], row["quantity"], row["source"]) for row in budgets]
    shares = [line["share"] for result in results for line in result["budget"]]
    assert [row["share"] for row in budgets] == pytest.approx(shares, rel=DIGITS)


def test_covariance_has_a_row_and_a_column_for_each_result(run: Path) -> None:
    document = document_of(run)
    keys = tuple((result.estimate.name, result.estimate.axis) for result in document.results)
    matrix = ((4.0, -1.5), (-1.5, 9.0))
    related = replace(document, covariance=Covariance(keys, matrix))
    sheets = read(workbook_of(RunFolder(run), related))
    assert [tuple(row.values())[1:] for row in sheets["Covariance"]] == list(matrix)
    assert list(sheets["Covariance"][0])[1:] == [row["result"] for row in sheets["Covariance"]]
    assert [row["code"] for row in sheets["Flags"]] == [flag.code for flag in document.flags]


def test_instruments_settings_and_the_head_of_the_log_are_there(run: Path) -> None:
    sheets = of(run)
    what = {row["what"]: row["value"] for row in sheets["Run"]}
    assert what["run"] == run.name and what["head_of_log"] == head_of_run(run)
    assert what["simulated"] is True
    assert {row["role"] for row in sheets["Instruments"]} >= {"coil supply", "gaussmeter"}
    assert all(row["parameter"] for row in sheets["Settings"])


def test_no_text_is_a_formula_and_what_a_cell_cannot_hold_is_replaced(run: Path) -> None:
    document = document_of(run)
    first, *rest = document.results
    altered = replace(first, estimate=replace(first.estimate, method="=HYPERLINK(0)\x00"))
    sheets = read(workbook_of(RunFolder(run), replace(document, results=[altered, *rest])))
    assert sheets["Results"][0]["method"] == "=HYPERLINK(0)\ufffd"


def test_a_certificate_is_no_workbook(run: Path) -> None:
    with pytest.raises(InputError, match="a certificate is no xlsx file"):
        remake_report(run, "xlsx", "certificate")
