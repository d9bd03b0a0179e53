"""The certificate of a run: its fields, why it is a draft, and its pages read back from the PDF."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from certified_run import FIELD, ROOM, THERMOMETER, TYPED, measured
from pypdf import PdfReader

from station.cli.reporting import remake_report
from station.errors import InputError, StationError
from station.findings import Flag
from station.plots import Line, Panel, Plot
from station.record.folder import RunFolder
from station.report.certificate import ambient_rows, certificate_of_run, room_rows, sheet_of
from station.report.certificate_fields import MANDATORY, REASONS, Certificate, RoomCondition
from station.report.certificate_results import result_row
from station.report.pdf import render_pdf
from station.report.report_sheet import report_sheet
from station.report.run_report import context_of_run
from station.report.sheet import Section, Sheet, grid, pairs
from station.report.sheet_html import render_sheet
from station.results import ResultDocument
from station.runner.evaluation import evaluate_run
from station.texts import Texts


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunFolder, ResultDocument]:
    folder = measured(tmp_path_factory.mktemp("certificate") / "whole", {})
    return folder, evaluate_run(folder)[0]


@pytest.fixture(scope="module")
def certificate(run: tuple[RunFolder, ResultDocument]) -> Certificate:
    return certificate_of_run(*run)


@pytest.fixture(scope="module")
def issuable(certificate: Certificate) -> Certificate:
    """The same of a bench that is not simulated."""
    flags = tuple(flag for flag in certificate.flags if flag.code != "simulated")
    return replace(certificate, flags=flags)


def texts_of(pdf: bytes) -> list[str]:
    return [page.extract_text() for page in PdfReader(io.BytesIO(pdf)).pages]


def test_a_simulated_bench_alone_makes_a_draft_of_a_certificate_that_is_filled_in(
    certificate: Certificate, issuable: Certificate
) -> None:
    (reason,) = certificate.draft_reasons()
    assert "simulated" in reason
    assert issuable.draft_reasons() == ()


@pytest.mark.parametrize(
    ("calibration", "said"),
    [
        (None, "No calibration record states the uncertainty of gaussmeter"),
        ({"date": "2019-01-15", "due": "2020-01-15"}, "gaussmeter was due on 2020-01-15"),
    ],
)
def test_an_instrument_without_a_record_or_with_an_old_one_makes_a_draft(
    tmp_path: Path, calibration: Mapping[str, Any] | None, said: str
) -> None:
    folder = measured(tmp_path / "run", calibration)
    reasons = certificate_of_run(folder, evaluate_run(folder)[0]).draft_reasons()
    assert any("simulated" in reason for reason in reasons)
    assert any(said in reason for reason in reasons), reasons


@pytest.mark.parametrize("name", MANDATORY)
def test_each_mandatory_field_that_is_empty_is_named(issuable: Certificate, name: str) -> None:
    assert getattr(issuable, name), "the run fills it in"
    emptied = replace(issuable, **{name: type(getattr(issuable, name))()})
    (reason,) = emptied.draft_reasons()
    clause, words, _ = MANDATORY[name]
    assert words in reason and clause in reason


def test_a_record_that_does_not_name_its_certificate_makes_a_draft(issuable: Certificate) -> None:
    first, *others = issuable.traceability
    rows = ((*first[:2], "", *first[3:]), *others)
    (reason,) = replace(issuable, traceability=rows).draft_reasons()
    assert first[0] in reason


TESTED = "2026-02-01 10:00:00 to 2026-02-01 11:00:00 UTC"


def test_each_statement_that_cannot_be_makes_a_draft_and_is_named(issuable: Certificate) -> None:
    sound = replace(issuable, tested=TESTED, days=("2026-02-01", "2026-02-03"))
    assert sound.draft_reasons() == ()
    record = sound.traceability[0]
    read = RoomCondition(
        "temperature", 21.0, 0.2, "°C", "Testo 622", "K-118", "2027-01-31", "A. Reader"
    )
    changes: dict[str, dict[str, Any]] = {
        "condition of the device is missing": {"condition": "."},
        "name of the customer is missing": {"customer": " "},
        "received on 2030-01-01": {"received": "2030-01-01"},
        "is dated 2026-03-01, after the test": {
            "traceability": ((*record[:3], "2026-03-01", *record[4:]),)
        },
        f"The calibration record of {record[0]} lacks": {"traceability": ((*record[:5], "-"),)},
        "Nobody states how well this is known, on which bias depends: latitude": {
            "unstated": (("latitude", "bias"),)
        },
        "temperature of the room was not typed": {"room": (replace(read, value=None),)},
        "Testo 622, whose calibration was due on 2026-02-02": {
            "room": (replace(read, due="2026-02-02"),)
        },
    }
    for said, change in changes.items():
        (reason,) = replace(sound, **change).draft_reasons()
        assert said in reason
    assert replace(sound, ambient=(), room=(read,)).draft_reasons() == ()
    # Where the day begins before it does in UTC.
    assert replace(sound, received="2026-02-02").draft_reasons() == ()


@pytest.mark.parametrize("code", REASONS)
def test_each_flag_of_which_no_certificate_is_issued_is_a_reason(
    issuable: Certificate, code: str
) -> None:
    flags = (*issuable.flags, Flag(code, f"What {code} says."))
    assert replace(issuable, flags=flags).draft_reasons() == (f"What {code} says.",)


def test_a_record_that_no_result_uses_and_an_input_that_nobody_states_make_a_draft(
    tmp_path: Path,
) -> None:
    unused = {"quantity": "time", "absolute": "1 ms", "coverage_factor": 2}
    calibration = {"uncertainty": [FIELD, unused]}
    folder = measured(tmp_path / "run", calibration)
    reasons = certificate_of_run(folder, evaluate_run(folder)[0]).draft_reasons()
    assert any("uncertainty of time, which the evaluation" in reason for reason in reasons)
    (unstated,) = [reason for reason in reasons if "cosine of the field" in reason]
    assert "on which magnetic sensitivity depends" in unstated


def test_the_room_that_a_person_typed_stands_on_the_certificate(tmp_path: Path) -> None:
    folder = measured(tmp_path / "run", {}, {"room": ROOM}, TYPED)
    (asked,) = [e.details for e in folder.events_of("prompt") if e.details["id"] in TYPED]
    assert (asked["answer"], asked["by"]) == ("45 %", "answers file")
    certificate = certificate_of_run(folder, evaluate_run(folder)[0])
    said = tuple(THERMOMETER.values())
    assert room_rows(certificate) == [
        ("temperature", "21.3 °C", "0.2 °C", *said, "A. Reader"),
        ("relative humidity", "45 %", "2 %", *said, "A. Reader"),
    ]
    assert len(certificate.draft_reasons()) == 1
    assert "Testo 622, 4711" in render_sheet(sheet_of(certificate))


@pytest.mark.parametrize("answers", [{}, {"room.humidity": "done"}, {"room.humidity": "140 %"}])
def test_a_run_without_the_reading_that_its_plan_asks_for_does_not_begin(
    tmp_path: Path, answers: Mapping[str, str]
) -> None:
    with pytest.raises(StationError, match=r"room\.humidity"):
        measured(tmp_path / "run", {}, {"room": ROOM}, answers)


def test_a_run_that_did_not_end_makes_a_draft(issuable: Certificate) -> None:
    assert len(replace(issuable, complete=False).draft_reasons()) == 1


def test_the_number_is_the_same_on_another_day_and_another_for_other_content(
    run: tuple[RunFolder, ResultDocument], certificate: Certificate
) -> None:
    folder, document = run
    assert certificate_of_run(folder, document).number == certificate.number
    less = replace(document, flags=())
    assert certificate_of_run(folder, less).number != certificate.number


@pytest.mark.parametrize(("paper", "width_mm"), [("a4", 210.0), ("letter", 215.9)])
def test_every_page_has_number_page_and_draft_and_all_texts_stand_within_it(
    certificate: Certificate, paper: str, width_mm: float
) -> None:
    pdf = PdfReader(io.BytesIO(render_pdf(sheet_of(certificate), paper=paper)))
    count = len(pdf.pages)
    assert count >= 2
    for number, page in enumerate(pdf.pages, start=1):
        width, height = float(page.mediabox.width), float(page.mediabox.height)
        assert width == pytest.approx(width_mm / 25.4 * 72, abs=0.1)
        text = page.extract_text()
        assert certificate.number in text
        assert f"Page {number} of {count}" in text
        assert "DRAFT" in text

        def inside(
            text: str, cm: list[float], tm: list[float], font: Any, size: float,
            width: float = width, height: float = height,
        ) -> None:  # fmt: skip
            if text.strip() and text.strip() != "DRAFT":
                x = tm[4] * cm[0] + tm[5] * cm[2] + cm[4]
                y = tm[4] * cm[1] + tm[5] * cm[3] + cm[5]
                assert 0 < x < width and 0 < y < height, text

        page.extract_text(visitor_text=inside)


def test_every_text_of_the_certificate_can_be_read_from_its_pages(issuable: Certificate) -> None:
    text = plain(" ".join(texts_of(render_pdf(sheet_of(issuable)))))
    assert "DRAFT" not in text
    rows = [*map(result_row, issuable.results), *issuable.traceability, *ambient_rows(issuable)]
    wanted = [cell for row in [*rows, *issuable.hashes] for cell in row]
    wanted += [issuable.customer, issuable.order, issuable.work_instruction, issuable.condition]
    wanted += [issuable.received, *issuable.deviations, "B. Head", "D-9", issuable.decision_rule]
    for one in wanted:
        assert plain(one.replace("-0", "−0")) in text or plain(one) in text, one
    assert "�" not in text


def plain(text: str) -> str:
    """Return a text without what only lays it out."""
    return "".join(text.split())


def test_a_long_table_repeats_its_head_and_no_column_is_cut() -> None:
    columns = [f"column {letter}" for letter in "ABCDEFGHIJKL"]
    rows = [[f"{n}{letter}-abcdefghijkl" for letter in "ABCDEFGHIJKL"] for n in range(60)]
    section = Section("Table", (grid(columns, rows), pairs((("long", 90 * "x"),))))
    pages = texts_of(render_pdf(Sheet("Report", "T", "N", "", "", "", (section,), contents=True)))
    assert len(pages) > 1
    assert "Contents" in pages[0]
    whole = plain("".join(pages))
    assert all(plain(cell) in whole for cell in (rows[0][-1], rows[-1][-1]))
    with_rows = [page for page in pages if "-abc" in page]
    assert all("column" in page for page in with_rows)


def test_a_long_word_breaks_before_the_next_column_begins() -> None:
    words = ("signal_generator.z_gradient", "A.02.14-02.40-02.14-00.49-02-01", "SIM-34465A-0001")
    table = grid(["Name", "Firmware", "Certificate"] * 3, [words * 3])
    threshold = "thresholds.field_differs_from_commanded"
    rows = pairs(((threshold, "0.01"), (90 * "x", "VALUE")))
    sheet = Sheet("Report", "T", "N", "", "", "", (Section("Table", (table, rows)),))
    (page,) = PdfReader(io.BytesIO(render_pdf(sheet))).pages
    text = page.extract_text()
    assert "differs_\nfrom" in text or "differs_from_\ncommanded" in text
    for word in (*words[:2], 90 * "x"):
        assert word not in text and word in plain(text), "on more than one line"


def test_two_languages_share_the_line_at_the_foot() -> None:
    sheet = Sheet("Report", "T", "N", "", "", "", (Section("S", (pairs((("a", "b"),)),)),))
    (text,) = texts_of(render_pdf(sheet.translated(Texts("zh+en"))))
    assert plain("第 1 页，共 1 页 / Page 1 of 1") in plain(text)


def test_the_page_in_html_stamps_a_draft_and_shows_the_same_fields(
    certificate: Certificate, issuable: Certificate
) -> None:
    draft, page = render_sheet(sheet_of(certificate)), render_sheet(sheet_of(issuable))
    assert '<p class="stamp"' in draft and '<p class="stamp"' not in page
    expanded = result_row(issuable.results[0])[3]
    for one in (issuable.number, issuable.customer, expanded, issuable.hashes[0][1]):
        assert one in page
    assert "<script" not in page and "http" not in page
    assert "`" not in draft and "<code>coil_geometry</code>" in draft


def test_a_letterhead_is_a_folder_of_the_laboratory(issuable: Certificate, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"letterhead\.typ"):
        render_pdf(sheet_of(issuable), letterhead=tmp_path)
    (tmp_path / "letterhead.typ").write_text(
        "#let letterhead(sheet) = [OUR OWN HEAD of #sheet.laboratory]", encoding="utf-8"
    )
    (tmp_path / "letterhead.html").write_text("<p>OUR <b>OWN</b></p>", encoding="utf-8")
    (first, *_) = texts_of(render_pdf(sheet_of(issuable), letterhead=tmp_path))
    assert "OUR OWN HEAD of Inertial Laboratory" in first
    assert "<p>OUR <b>OWN</b></p>" in render_sheet(sheet_of(issuable), tmp_path)
    (tmp_path / "letterhead.typ").write_text("#let letterhead(sheet) = nothing", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be set"):
        render_pdf(sheet_of(issuable), letterhead=tmp_path)


def test_a_certificate_is_written_into_exports_and_is_no_table(
    run: tuple[RunFolder, ResultDocument], capsys: pytest.CaptureFixture[str]
) -> None:
    path = run[0].path
    remake_report(path, "html", "certificate")
    written = capsys.readouterr().out.split()
    assert written == [str(path / "exports" / "certificate.html")]
    with pytest.raises(InputError, match="no csv file"):
        remake_report(path, "csv", "certificate")


def test_the_report_as_pdf_has_contents_plots_tables_and_references(
    run: tuple[RunFolder, ResultDocument],
) -> None:
    folder, document = run
    context = context_of_run(folder)
    plot = Plot("The line", "It rises.", (Panel((Line([0, 1], [0, 1]),)),))
    sheet = report_sheet("N-1", context, document, [plot])
    pages = PdfReader(io.BytesIO(render_pdf(sheet))).pages
    text = plain("".join(page.extract_text() for page in pages))
    assert sum(len(page.images) for page in pages) == 2, "the plot, and the QR code"
    budget = document.results[0].budget[0].description
    for words in ("Contents", budget, "PO-4711", f"Page 1 of {len(pages)}", "It rises."):
        assert plain(words) in text, words


def test_the_mandatory_list_names_fields_of_the_certificate() -> None:
    assert set(MANDATORY) <= {field.name for field in fields(Certificate)}


def test_what_a_person_typed_is_in_that_persons_words_in_every_language(
    issuable: Certificate,
) -> None:
    words = {"Axis", "pass", "Serial number", "Results", "temperature"}
    typed = replace(
        issuable,
        laboratory="Results",
        customer="Serial number",
        customer_address="",
        order="pass",
        operator="temperature",
        device=(("Model", "Axis"),),
    )
    page = render_sheet(sheet_of(typed).translated(Texts("zh")))
    assert words <= {text.strip() for text in re.findall(">([^<>]+)<", page)}
    assert "型号" in page
