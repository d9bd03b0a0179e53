"""The register of certificates: numbers are given once, and what was issued is kept and proven."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from certified_run import measured
from pypdf import PdfReader

from station.cli.analysing import new_revision
from station.cli.looking import list_what_there_is
from station.cli.reporting import NOT_ISSUED, issue_certificate, remake_report
from station.cli.verifying import verified_run, verify_runs
from station.errors import DamagedRecord, InputError, StationError
from station.files.statements import says_something
from station.record import layout
from station.record.certificates import Issue, in_force, issues_of, keep, kept_pdf
from station.record.events import ISSUED, REVISED, head_of_run, read_events
from station.record.files import not_written
from station.record.folder import RunFolder
from station.record.layout import CERTIFICATES, EVENTS, MANIFEST, covered_files, write_manifest
from station.record.signatures import new_key, sign
from station.record.verification import verify
from station.report import certificate_fields
from station.report.seal import seal
from station.runner.evaluation import evaluate_run

FIRST = Issue("N-1", "2026-03-01", "RLG-50 SN-1", "Ring Gyros Ltd", ("en",), "c", "r")
KILLED_AT_EACH_STEP = """
import os, shutil, signal, sys
from pathlib import Path
from station.record.certificates import Issue, keep
run, copies = map(Path, sys.argv[1:])
steps = ("open", "os.rename", "os.mkdir", "os.truncate", "os.remove")
for step in range(1, 200):
    copy = copies / f"{step}"
    shutil.copytree(run, copy)
    child = os.fork()
    if not child:
        count = 0
        def hook(event, arguments):
            global count
            count += event in steps
            if count == step:
                count = 1000  # a kill is an event, too
                os.kill(os.getpid(), signal.SIGKILL)
        sys.addaudithook(hook)
        keep(copy, Issue("N-1", "2026-03-01", "", "", ("en",), "c", "r"), b"%PDF" * 5000)
        os._exit(0)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0:
        break
else:
    sys.exit("it never ended")
"""


@pytest.fixture(scope="module")
def measured_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return measured(tmp_path_factory.mktemp("register") / "whole", {}).path


@pytest.fixture
def run(measured_once: Path, tmp_path: Path) -> Path:
    copy = tmp_path / measured_once.name
    shutil.copytree(measured_once, copy)
    return copy


@pytest.fixture
def real(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a certificate of a simulated bench be one."""
    others = tuple(code for code in certificate_fields.REASONS if code != "simulated")
    monkeypatch.setattr(certificate_fields, "REASONS", others)


def issue(run: Path, replaces: str = "", reason: str = "", language: str = "en") -> None:
    issue_certificate(run, "certificate", "a4", None, language, replaces, reason)


def issued(run: Path) -> list[Issue]:
    return list(issues_of(RunFolder(run).events).values())


def text_of(pdf: bytes) -> str:
    return "".join(
        "".join(page.extract_text().split()) for page in PdfReader(io.BytesIO(pdf)).pages
    )


@pytest.mark.usefixtures("real")
def test_an_issued_certificate_is_kept_in_log_and_manifest_and_comes_out_the_same(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = head_of_run(run)
    issue(run)
    (only,) = issued(run)
    assert capsys.readouterr().out.strip() == str(run / only.file)
    pdf = (run / only.file).read_bytes()
    text = text_of(pdf)
    assert "DRAFT" not in text and only.number in text and only.date in text
    assert only.file in covered_files(run)
    assert verify(run).state == "unchanged"
    assert before in text, "the head of the run itself"
    (command, _) = (row[1] for row in reversed(seal(run.name, before).rows))
    since = verified_run(run, head=command).since
    assert since is not None and [event.kind for event in since] == [REVISED, ISSUED]
    with pytest.raises(InputError, match=f"{only.number} was issued.*leave --paper out"):
        remake_report(run, "pdf", "certificate", "letter")
    for _ in range(2):
        remake_report(run, "pdf", "certificate")
        assert (run / "exports" / "certificate.pdf").read_bytes() == pdf
    assert verify_runs([run], as_json=False, head=command) == 0
    assert f"certificate {only.number} was issued" in capsys.readouterr().out


@pytest.mark.usefixtures("real")
def test_what_is_no_issued_pdf_is_a_draft(run: Path) -> None:
    remake_report(run, "dcc", "certificate")
    digital = (run / "exports" / "certificate.dcc.xml").read_text(encoding="utf-8")
    assert f"Draft: {NOT_ISSUED}" in digital
    remake_report(run, "html", "certificate")
    page = run / "exports" / "certificate.html"
    assert "This is a preview" in page.read_text(encoding="utf-8")
    issue(run)
    remake_report(run, "html", "certificate")
    assert "This is a copy in another form" in page.read_text(encoding="utf-8")
    remake_report(run, "pdf", "certificate", language="zh+en")
    pdf = run / "exports" / "certificate.pdf"
    assert "DRAFT" in text_of(pdf.read_bytes())


def test_a_draft_is_not_issued(run: Path) -> None:
    with pytest.raises(InputError, match="of a draft"):
        issue(run)
    assert not (run / CERTIFICATES).exists() and not issued(run)


@pytest.mark.usefixtures("real")
def test_what_may_not_be_issued_is_refused_in_a_sentence(run: Path) -> None:
    with pytest.raises(InputError, match="choose --kind certificate"):
        issue_certificate(run, "report", "a4", None, None, "", "")
    with pytest.raises(InputError, match=r"no certificate N-9 of this run; issued: none"):
        issue(run, "N-9", "a slip")
    issue(run)
    (first,) = issued(run)
    with pytest.raises(InputError, match=f"was issued on .*--replaces {first.number}"):
        issue(run)
    for replaces, reason in ((first.number, " "), ("", "a slip"), (first.number, "two\nlines")):
        with pytest.raises(InputError, match="says in a line why"):
            issue(run, replaces, reason)
    with pytest.raises(InputError, match=f"certificate {first.number} says the same"):
        issue(run, first.number, "a slip")
    issue(run, first.number, "The customer reads Chinese.", "zh+en")
    with pytest.raises(InputError, match="was replaced already, by"):
        issue(run, first.number, "once more", "zh")
    assert len(issued(run)) == 2
    (run / "results.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="ALTERED"):
        issue(run, issued(run)[1].number, "once more", "zh")


@pytest.mark.usefixtures("real")
def test_an_amended_certificate_names_the_one_it_replaces_and_both_are_listed(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    issue(run)
    (first,) = issued(run)
    reason = "The customer reads Chinese."
    issue(run, first.number, reason, "zh+en")
    second = issued(run)[1]
    assert (second.replaces, second.reason) == (first.number, reason)
    text = text_of((run / second.file).read_bytes())
    for words in (
        f"replaces certificate {first.number}, issued on {first.date}",
        reason,
        "原证书作废",
    ):
        assert "".join(words.split()) in text
    capsys.readouterr()
    list_what_there_is("certificates", store=str(run.parent), as_json=True)
    rows = json.loads(capsys.readouterr().out)["certificates"]
    assert [(row["number"], row["replaces"], row["replaced_by"]) for row in rows] == [
        (second.number, first.number, ""),
        (first.number, "", second.number),
    ]
    keys = ("run", "date", "device", "customer", "state")
    assert [rows[1][key] for key in keys] == [
        run.name,
        first.date,
        "RLG-50 SN-1" if "RLG-50" in first.device else first.device,
        "Ring Gyros Ltd",
        "kept",
    ]
    remake_report(run, "dcc", "certificate")
    digital = (run / "exports" / "certificate.dcc.xml").read_text(encoding="utf-8")
    assert f"replaces certificate {first.number}" in digital
    assert NOT_ISSUED not in digital
    issue(run, second.number, "English was right.", "en")  # as the withdrawn one was
    second = issued(run)[2]
    moved = run.rename(run.parent / "put elsewhere")
    assert verify(moved).state == "unchanged"
    remake_report(moved, "pdf", "certificate")
    kept = (moved / "exports" / "certificate.pdf").read_bytes()
    assert kept == (moved / second.file).read_bytes()
    remake_report(moved, "dcc", "certificate")
    digital = (moved / "exports" / "certificate.dcc.xml").read_text(encoding="utf-8")
    assert f">{second.number}<" in digital or f">DRAFT-{second.number}<" in digital


@pytest.mark.usefixtures("real")
def test_a_copy_issued_in_another_form_has_another_number(run: Path) -> None:
    copy = run.parent / "copy" / run.name
    shutil.copytree(run, copy)
    issue(run)
    issue(copy, language="zh")
    assert issued(run)[0].says == issued(copy)[0].says
    assert issued(run)[0].number != issued(copy)[0].number


@pytest.mark.usefixtures("real")
def test_results_that_say_the_same_on_paper_need_no_other_certificate(run: Path) -> None:
    issue(run)
    (only,) = issued(run)
    folder = RunFolder(run)
    document, findings = evaluate_run(folder)
    estimates = [replace(e, extra={**e.extra, "noticed": 1}) for e in findings.estimates]
    results = [replace(r, estimate=e) for r, e in zip(document.results, estimates, strict=True)]
    new_revision(folder, replace(document, results=results), findings)
    remake_report(run, "pdf", "certificate")
    pdf = (run / "exports" / "certificate.pdf").read_bytes()
    assert pdf == (run / only.file).read_bytes()


def test_the_command_of_the_seal_is_whole_for_a_shell() -> None:
    (_, (_, command)) = seal("a run; rm -rf", "ab").rows
    assert command == "station verify 'a run; rm -rf' --head ab"


def test_what_a_saboteur_does_to_kept_certificates_is_named(run: Path) -> None:
    signature = sign_first(run)
    keep(run, FIRST, b"%PDF issued")
    kept = run / FIRST.file
    state = verify(run)
    assert state.state == "unchanged"
    assert [sign.state for sign in state.signatures] == ["earlier"], signature
    events = RunFolder(run).events
    kept.write_bytes(b"%PDF edited")
    assert f"{kept} was changed" in " ".join(verify(run).changed)
    with pytest.raises(DamagedRecord, match="is altered"):
        kept_pdf(run, events, FIRST)
    forge_manifest(run)
    assert f"{kept} was changed" in " ".join(verify(run).changed)
    kept.unlink()
    assert f"{kept} is missing" in " ".join(verify(run).changed)
    with pytest.raises(DamagedRecord, match="is missing"):
        kept_pdf(run, events, FIRST)
    shutil.rmtree(run / CERTIFICATES)
    assert f"{kept} is missing" in " ".join(verify(run).changed)
    kept.parent.mkdir()
    kept.write_bytes(b"%PDF issued")
    other = kept.with_name("N-2.pdf")
    other.write_bytes(b"%PDF of another run")
    assert f"{other} was added" in " ".join(verify(run).changed)


def sign_first(run: Path) -> str:
    from datetime import UTC, datetime

    key = run.parent / "key.pem"
    new_key(key)
    return sign(run, key, "B. Head", datetime(2026, 3, 1, tzinfo=UTC)).file


def forge_manifest(run: Path) -> None:
    """Write the manifest anew, as whoever edits a file would."""
    from station.record.layout import hashes_of_files

    write_manifest(run, hashes_of_files(run))


def test_of_two_issues_at_the_same_time_one_wins(run: Path) -> None:
    def issue_as(number: str) -> str:
        try:
            keep(run, replace(FIRST, number=number), number.encode())
        except StationError as error:
            return str(error)
        return ""

    with ThreadPoolExecutor(4) as several:
        refused = list(several.map(issue_as, ("A", "B", "C", "D")))
    assert refused.count("") == 1
    (only,) = issued(run)
    assert kept_pdf(run, RunFolder(run).events, only) == only.number.encode()
    assert verify(run).state == "unchanged"


def test_a_killed_issue_leaves_nothing_or_a_whole_certificate(run: Path, tmp_path: Path) -> None:
    copies = tmp_path / "copies"
    copies.mkdir()
    program = [sys.executable, "-c", KILLED_AT_EACH_STEP, str(run), str(copies)]
    subprocess.run(program, check=True, timeout=120)
    left = {}
    for copy in copies.iterdir():
        assert not verify(copy).changed, copy
        events = tuple(read_events(copy / EVENTS))
        current = in_force(issues_of(events))
        left[copy] = current is not None
        if current is not None:
            assert kept_pdf(copy, events, current) == b"%PDF" * 5000
            keep(copy, replace(FIRST, number="N-2", replaces="N-1", reason="x"), b"%PDF 2")
        else:
            keep(copy, FIRST, b"%PDF 1")
        assert verify(copy).state == "unchanged"
        names = {file.name for file in (copy / CERTIFICATES).iterdir()}
        assert names == ({"N-1.pdf", "N-2.pdf"} if left[copy] else {"N-1.pdf"})
        assert {f"{CERTIFICATES}/{name}" for name in names} <= {
            *covered_files(copy),
            FIRST.file,
        }, MANIFEST
    assert len(left) > 8 and {*left.values()} == {False, True}


def test_what_a_kill_leaves_of_a_new_manifest_is_no_damage(run: Path) -> None:
    (run / f".{MANIFEST}.part").write_bytes(b"{")
    assert verify(run).state == "unchanged"
    (run / ".other.json.part").write_bytes(b"{")
    assert verify(run).changed


def test_a_certificate_whose_manifest_is_not_renewed_is_issued(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(path: Path, data: bytes, otherwise: str) -> None:
        raise not_written(path, OSError(errno.ENOSPC, "No space left on device"), otherwise)

    monkeypatch.setattr(layout, "write_whole_file", full)
    head = keep(run, FIRST, b"%PDF 1")
    said = capsys.readouterr().err
    assert "is issued" in said and "--output" not in said
    assert head == hashlib.sha256((run / EVENTS).read_bytes().splitlines()[-1]).hexdigest()
    assert [only.number for only in issued(run)] == ["N-1"]
    assert not verify(run).changed
    monkeypatch.undo()
    new_revision(RunFolder(run), *evaluate_run(RunFolder(run)))
    assert FIRST.file in covered_files(run)
    assert verify(run).state == "unchanged"


def test_an_issue_that_waits_for_another_one_is_refused_and_never_called_issued(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keep(run, FIRST, b"%PDF 1")
    lock = layout.run_lock(run)
    with pytest.raises(StationError, match="in use by another process"):
        keep(run, FIRST, b"%PDF 1")
    lock.release()
    assert "is issued" not in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "",
        " . ",
        "n/a",
        "N/A",
        "TBD.",
        "to be defined",
        "xxx",
        "-",
        "待定",
        "TBD\u200b",
        "\u3164",
        "<name>",
        "0",
    ],
)
def test_what_stands_for_nothing_says_nothing(text: str) -> None:
    assert not says_something(text)


@pytest.mark.parametrize(
    "text", ["A", "7", "0 %", "室温计", "NA-17", "XX-1", "Na", "Null", "No damage"]
)
def test_a_short_word_says_something(text: str) -> None:
    assert says_something(text)
