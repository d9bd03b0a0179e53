"""`station report`: what a run measured, for people and for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from station.cli.analysing import name_unused, new_revision
from station.console import tell
from station.errors import InputError
from station.record.files import A_COPY, replaced
from station.record.folder import EXPORTS, REPORT, RunFolder, read_run
from station.report.revision import Revision, newest_revision
from station.runner.evaluation import evaluate_run
from station.speech import HERE
from station.texts import ENGLISH, Texts, choices

if TYPE_CHECKING:
    from station.report.sheet import Sheet
    from station.results import ResultDocument

FOR_PEOPLE = ("html", "pdf")
HEADED = (("report", "pdf"), ("certificate", "pdf"), ("certificate", "html"))
"""What has a letterhead."""
FILES = {
    ("report", "html"): REPORT,
    ("report", "pdf"): "report.pdf",
    ("report", "csv"): "results.csv",
    ("report", "junit"): "results.junit.xml",
    ("report", "xlsx"): "results.xlsx",
    ("certificate", "html"): "certificate.html",
    ("certificate", "pdf"): "certificate.pdf",
    ("report", "dcc"): "certificate.dcc.xml",
    ("certificate", "dcc"): "certificate.dcc.xml",
}


def remake_report(
    path: Path,
    format: str,
    kind: str,
    paper: str = "a4",
    letterhead: Path | None = None,
    language: str | None = None,
    schema: Path | None = None,
) -> None:
    """Make the report or certificate of a run into its `exports`, which no manifest covers.

    Without a `language` it is in that of this terminal. Prints the path of what was written. Raises
    InputError where a certificate is asked for as a table of results, a letterhead or a schema for
    what has none, a language that there is not, or where a dcc does not follow the `schema`.
    """
    name = FILES.get((kind, format))
    if name is None:
        raise InputError(f"a {kind} is no {format} file; choose --format html or --format pdf")
    if letterhead is not None and (kind, format) not in HEADED:
        raise InputError(f"a {kind} as {format} has no letterhead; leave --letterhead out")
    if schema is not None and format != "dcc":
        raise InputError(f"{format} has no schema; leave --schema out")
    texts = texts_of(language, format)
    folder = read_run(path)
    folder.damage.refuse_altered()
    file = path / EXPORTS / name
    with replaced(file, A_COPY, parents=True) as part:
        if format == "dcc":
            part.write_bytes(digital_certificate(folder, schema))
        else:
            make = certificate if kind == "certificate" else report
            part.write_bytes(make(folder, format, paper, letterhead, texts))
        name_unused(folder)
    print(file)


def revision_of(folder: RunFolder, *, drawn: bool) -> Revision:
    """Return the newest revision of a run; where there is none, it is evaluated into one.

    `drawn`: with plots, which a revision of before they were data does not have.
    """
    revision = newest_revision(folder)
    if revision is None or (drawn and not revision.drawn):
        document, findings = evaluate_run(folder)
        why = "no revision stands for the run as it is now"
        if revision is not None:
            why = f"revision {revision.path.name} has no plots"
        revision = Revision(new_revision(folder, document, findings))
        tell(f"{why}: evaluated once more, into {revision.path}")
    return revision


def texts_of(language: str | None, format: str) -> Texts:
    """Return the texts of a language as `--lang` names it; raises InputError."""
    if language is None:
        return Texts(HERE.language if format in FOR_PEOPLE else ENGLISH)
    if language not in choices():
        raise InputError(f"no report is in {language!r}; choose --lang {', '.join(choices())}")
    if language != ENGLISH and format not in FOR_PEOPLE:
        raise InputError(f"{format} is for other programs and in English; leave --lang out")
    return Texts(language)


def certificate(
    folder: RunFolder, format: str, paper: str, letterhead: Path | None, texts: Texts
) -> bytes:
    """Return the certificate of a run as html or pdf; say why where it is a draft."""
    from station.report.certificate import certificate_of_run, sheet_of

    document = revision_of(folder, drawn=False).document
    sheet = sheet_of(certificate_of_run(folder, document))
    for reason in sheet.drafts:
        tell(f"draft: {reason}")
    sheet = sheet.translated(texts)
    if format == "pdf":
        return pdf_of(sheet, paper, letterhead)
    from station.report.sheet_html import render_sheet

    return render_sheet(sheet, letterhead).encode()


def digital_certificate(folder: RunFolder, schema: Path | None) -> bytes:
    """Return the certificate of a run as a dcc, held against a schema where there is one."""
    from station.report.dcc import dcc_of_run
    from station.report.xml_schema import refuse_invalid

    xml, drafts = dcc_of_run(folder, revision_of(folder, drawn=False).document)
    for reason in drafts:
        tell(f"draft: {reason}")
    if schema is not None:
        refuse_invalid(xml, schema)
    return xml


def report(
    folder: RunFolder, format: str, paper: str, letterhead: Path | None, texts: Texts
) -> bytes:
    """Return the report of a run in a format: html, pdf, csv, junit or xlsx."""
    revision = revision_of(folder, drawn=format in FOR_PEOPLE)
    document = revision.document
    if format == "xlsx":
        from station.report.workbook import workbook_of

        return workbook_of(folder, document)
    if format not in FOR_PEOPLE:
        # A spreadsheet reads UTF-8 as such by its byte order mark only.
        coding = "utf-8-sig" if format == "csv" else "utf-8"
        return table_of(folder, document, format).encode(coding)
    from station.report.run_report import context_of_run, report_of_run

    if format == "html":
        return report_of_run(folder, document, revision.parts, texts).encode()
    from station.report.report_sheet import report_sheet

    context = context_of_run(folder)
    number = folder.path.resolve().name
    sheet = report_sheet(number, context, document, revision.parts, texts).translated(texts)
    return pdf_of(sheet, paper, letterhead)


def pdf_of(sheet: Sheet, paper: str, letterhead: Path | None) -> bytes:
    """Return a sheet as PDF."""
    from station.report.pdf import render_pdf

    return render_pdf(sheet, paper=paper, letterhead=letterhead)


def table_of(folder: RunFolder, document: ResultDocument, format: str) -> str:
    """Return the results for other programs: csv or junit."""
    from station.report.tables import csv_of, junit_of

    return csv_of(document) if format == "csv" else junit_of(folder, document)
