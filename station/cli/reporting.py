"""`station report`: what a run measured, for people and for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from station.cli.analysing import name_unused
from station.console import tell
from station.errors import InputError
from station.record.files import A_COPY, replaced
from station.record.folder import EXPORTS, REPORT, RunFolder, read_run
from station.runner.evaluation import evaluate_run
from station.texts import ENGLISH, Texts, choices

if TYPE_CHECKING:
    from station.report.sheet import Sheet
    from station.results import ResultDocument

FILES = {
    ("report", "html"): REPORT,
    ("report", "pdf"): "report.pdf",
    ("report", "csv"): "results.csv",
    ("report", "junit"): "results.junit.xml",
    ("certificate", "html"): "certificate.html",
    ("certificate", "pdf"): "certificate.pdf",
}


def remake_report(
    path: Path,
    format: str,
    kind: str,
    paper: str = "a4",
    letterhead: Path | None = None,
    language: str = ENGLISH,
) -> None:
    """Make the report or certificate of a run into its `exports`, which no manifest covers.

    Prints the path of what was written. Raises InputError where a certificate is asked for as a
    table of results, a letterhead for what has none, or a language that there is not.
    """
    name = FILES.get((kind, format))
    if name is None:
        raise InputError(f"a {kind} is no {format} file; choose --format html or --format pdf")
    if letterhead is not None and kind != "certificate" and format != "pdf":
        raise InputError(f"a {kind} as {format} has no letterhead; leave --letterhead out")
    texts = texts_of(language, format)
    folder = read_run(path)
    file = path / EXPORTS / name
    content = (
        certificate(folder, format, paper, letterhead, texts) if kind == "certificate" else None
    )
    content = content or report(folder, format, paper, letterhead, texts)
    name_unused(folder)
    with replaced(file, A_COPY, parents=True) as part:
        part.write_bytes(content)
    print(file)


def texts_of(language: str, format: str) -> Texts:
    """Return the texts of a language as `--lang` names it; raises InputError."""
    if language not in choices():
        raise InputError(f"no report is in {language!r}; choose --lang {', '.join(choices())}")
    if language != ENGLISH and format in ("csv", "junit"):
        raise InputError(f"{format} is for other programs and in English; leave --lang out")
    return Texts(language)


def certificate(
    folder: RunFolder, format: str, paper: str, letterhead: Path | None, texts: Texts
) -> bytes:
    """Return the certificate of a run as html or pdf; say why where it is a draft."""
    from station.report.certificate import certificate_of_run, sheet_of

    document, _ = evaluate_run(folder)
    sheet = sheet_of(certificate_of_run(folder, document))
    for reason in sheet.drafts:
        tell(f"draft: {reason}")
    sheet = sheet.translated(texts)
    if format == "pdf":
        return pdf_of(sheet, paper, letterhead)
    from station.report.sheet_html import render_sheet

    return render_sheet(sheet, letterhead).encode()


def report(
    folder: RunFolder, format: str, paper: str, letterhead: Path | None, texts: Texts
) -> bytes:
    """Return the report of a run in a format: html, pdf, csv or junit."""
    document, findings = evaluate_run(folder)
    if format in ("csv", "junit"):
        # A spreadsheet reads UTF-8 as such by its byte order mark only.
        coding = "utf-8-sig" if format == "csv" else "utf-8"
        return table_of(folder, document, format).encode(coding)
    from station.report.run_report import context_of_run, report_of_run

    if format == "html":
        return report_of_run(folder, document, findings, texts).encode()
    from station.report.drawing import parts_of
    from station.report.report_sheet import report_sheet

    context, procedure = context_of_run(folder)
    parts = parts_of(procedure, findings, document)
    number = folder.path.resolve().name
    sheet = report_sheet(number, context, document, parts).translated(texts)
    return pdf_of(sheet, paper, letterhead)


def pdf_of(sheet: Sheet, paper: str, letterhead: Path | None) -> bytes:
    """Return a sheet as PDF."""
    from station.report.pdf import render_pdf

    return render_pdf(sheet, paper=paper, letterhead=letterhead)


def table_of(folder: RunFolder, document: ResultDocument, format: str) -> str:
    """Return the results for other programs: csv or junit."""
    from station.report.tables import csv_of, junit_of

    return csv_of(document) if format == "csv" else junit_of(folder, document)
