"""`station report`: what a run measured, for people and for other programs."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from station.cli.analysing import name_unused, new_revision
from station.cli.verifying import against_history
from station.console import tell
from station.errors import InputError
from station.files.statements import says_something
from station.record.certificates import Issue, in_force, issues_of, keep, kept_pdf, refuse_second
from station.record.files import A_COPY, replaced
from station.record.folder import REPORT, RESULTS, RunFolder, read_run
from station.record.layout import EXPORTS, file_hash
from station.recorded import read_plan_and_bench
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
NOT_ISSUED = (
    "This is a preview: `station report RUN --kind certificate --issue` issues the certificate."
)
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
    paper: str | None = None,
    letterhead: Path | None = None,
    language: str | None = None,
    schema: Path | None = None,
) -> None:
    """Make the report or certificate of a run into its `exports`, which no manifest covers.

    Without a `language` it is in that of this terminal, without a `paper` for A4. Prints the path
    of what was written. Raises InputError where a certificate is asked for as a table of results, a
    letterhead or a schema for what has none, a paper for a PDF that was issued, a language that
    there is not, or where a dcc does not follow the `schema`.
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
            made = digital_certificate(folder, schema)
        elif kind == "certificate":
            same = language is None or texts.languages == languages_in_force(folder)
            made = certificate(folder, format, paper, letterhead, texts, as_issued=same)
        else:
            made = report(folder, format, paper, letterhead, texts)
        part.write_bytes(made)
        name_unused(folder)
    print(file)


def languages_in_force(folder: RunFolder) -> tuple[str, ...]:
    """Return the languages of the certificate in force; none where there is none."""
    current = in_force(issues_of(folder.events))
    return () if current is None else current.languages


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
    folder: RunFolder,
    format: str,
    paper: str | None,
    letterhead: Path | None,
    texts: Texts,
    *,
    as_issued: bool = True,
) -> bytes:
    """Return the certificate of a run as html or pdf; say why where it is a draft.

    The one in force is the PDF that was issued, as long as its results are the newest; what is in
    another form, for which `as_issued` is not set, is no certificate, and a draft.
    """
    from station.report.certificate import certificate_of_run, sheet_of

    revision = revision_of(folder, drawn=False)
    current, amendment, unissued = as_issued_now(folder, revision)
    number = ""
    if current is not None and not unissued:
        if format == "pdf" and as_issued and letterhead is None:
            if paper is not None:
                raise InputError(
                    f"certificate {current.number} was issued, and its PDF is given again as it "
                    "is; leave --paper out"
                )
            return kept_pdf(folder.path, folder.events, current)
        number = current.number
        unissued = f"This is a copy in another form: issued is certificate {number}."
    form = form_of(paper, letterhead, texts)
    sheet = sheet_of(certificate_of_run(folder, revision.document, amendment, form))
    sheet = replace(sheet, number=number or sheet.number, drafts=(*sheet.drafts, unissued))
    for reason in sheet.drafts:
        tell(f"draft: {reason}")
    sheet = sheet.translated(texts)
    if format == "pdf":
        return pdf_of(sheet, paper, letterhead)
    from station.report.sheet_html import render_sheet

    return render_sheet(sheet, letterhead).encode()


def as_issued_now(
    folder: RunFolder, revision: Revision
) -> tuple[Issue | None, tuple[str, ...], str]:
    """Return the certificate in force, its amendment, and why what is made now is not issued.

    That is empty where the one in force says the same: it is of the same results, or of others that
    have nothing else for a certificate.
    """
    from station.report.certificate import amendment_of, certificate_of_run, content_of

    issues = issues_of(folder.events)
    current = in_force(issues)
    if current is None:
        return None, (), NOT_ISSUED
    amendment: tuple[str, ...] = ()
    if current.replaces:
        replaced_on = issues[current.replaces].date
        amendment = amendment_of(current.replaces, replaced_on, current.reason)
    same = current.results == file_hash(revision.path / RESULTS)
    if same or current.says == content_of(certificate_of_run(folder, revision.document)):
        return current, amendment, ""
    return (
        current,
        (),
        f"This is a preview: issued is certificate {current.number}, of other results; "
        "`--issue --replaces NUMBER --reason TEXT` issues an amended one.",
    )


def digital_certificate(folder: RunFolder, schema: Path | None) -> bytes:
    """Return the certificate of a run as a dcc, held against a schema where there is one."""
    from station.report.certificate import certificate_of_run
    from station.report.dcc import dcc_of
    from station.report.xml_schema import refuse_invalid

    revision = revision_of(folder, drawn=False)
    current, amendment, unissued = as_issued_now(folder, revision)
    made = certificate_of_run(folder, revision.document, amendment)
    if current is not None and not unissued:
        made = replace(made, number=current.number)
    xml, drafts = dcc_of(made, unissued)
    for reason in drafts:
        tell(f"draft: {reason}")
    if schema is not None:
        refuse_invalid(xml, schema)
    return xml


def issue_certificate(
    path: Path,
    kind: str,
    paper: str,
    letterhead: Path | None,
    language: str | None,
    replaces: str,
    reason: str,
) -> None:
    """Issue the certificate of a run: its number is given once, its PDF kept in the run folder.

    Prints its path. Raises InputError for a draft, a folder that is not as its run left it, a
    second certificate that replaces none, one that says nothing new, and a reason that is missing.
    """
    if kind != "certificate":
        raise InputError(f"a {kind} is not issued; choose --kind certificate")
    if bool(replaces) != says_something(reason) or not reason.isprintable():
        raise InputError(
            "an amended certificate names the one that it replaces, and says in a line why: give "
            "--replaces NUMBER and --reason TEXT"
        )
    texts = texts_of(language, "pdf")
    folder = read_run(path)
    if folder.damage.state != "unchanged":
        raise InputError(f"{path.name}: no certificate is issued: {folder.damage.sentence()}")
    for altered in against_history(path):
        raise InputError(f"{path.name}: no certificate is issued: {altered}")
    issues = issues_of(folder.events)
    refuse_second(issues, replaces)
    from station.report.certificate import amendment_of, certificate_of_run, content_of, sheet_of

    revision = revision_of(folder, drawn=False)
    amendment = amendment_of(replaces, issues[replaces].date, reason.strip()) if replaces else ()
    form = form_of(paper, letterhead, texts)
    made = certificate_of_run(folder, revision.document, amendment, form)
    if drafts := made.draft_reasons():
        for sentence in drafts:
            tell(f"draft: {sentence}")
        raise InputError(f"{path.name}: no certificate is issued of a draft")
    says = content_of(made)
    plan = read_plan_and_bench(folder)[0]
    issue = Issue(
        number=made.number,
        date=made.issued,
        device=f"{plan.dut.model} {plan.dut.serial}",
        customer=made.customer,
        languages=texts.languages,
        content=hashlib.sha256(f"{says} {form}".encode()).hexdigest(),
        says=says,
        results=file_hash(revision.path / RESULTS),
        replaces=replaces,
        reason=reason.strip(),
    )
    current = in_force(issues)
    if current is not None and current.content == issue.content:
        raise InputError(f"certificate {current.number} says the same; nothing is issued")
    head = keep(path, issue, pdf_of(sheet_of(made).translated(texts), paper, letterhead))
    tell(f"certificate {issue.number} is issued; the head of the log is now {head}")
    name_unused(folder)
    print(path / issue.file)


def form_of(paper: str | None, letterhead: Path | None, texts: Texts) -> str:
    """Return paper, languages, and a SHA-256 of the files of a letterhead where there is one."""
    head = ""
    if letterhead is not None and letterhead.is_dir():
        files = sorted(file for file in letterhead.iterdir() if file.is_file())
        listed = "\n".join(f"{file.name} {file_hash(file)}" for file in files)
        head = hashlib.sha256(listed.encode()).hexdigest()
    return f"{paper or 'a4'} {texts.languages} {head}"


def report(
    folder: RunFolder, format: str, paper: str | None, letterhead: Path | None, texts: Texts
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


def pdf_of(sheet: Sheet, paper: str | None, letterhead: Path | None) -> bytes:
    """Return a sheet as PDF."""
    from station.report.pdf import render_pdf

    return render_pdf(sheet, paper=paper or "a4", letterhead=letterhead)


def table_of(folder: RunFolder, document: ResultDocument, format: str) -> str:
    """Return the results for other programs: csv or junit."""
    from station.report.tables import csv_of, junit_of

    return csv_of(document) if format == "csv" else junit_of(folder, document)
