"""Reports in other languages: no heading without its translation, none that nothing uses."""

from __future__ import annotations

import ast
import os
import re
from functools import cache
from pathlib import Path

import pytest

from station import registry
from station.errors import InputError
from station.procedure import procedure_of
from station.report.html import BADGES, DETAILS, RULES, VERDICTS
from station.report.pdf import FIRST_IDEOGRAPH, font_with, render_pdf
from station.report.sheet import PRINTED, Section, Sheet, grid, pairs
from station.report.sheet_html import render_sheet
from station.texts import FLAGS, REPORT, Texts, catalogue, choices

ROOT = Path(__file__).parents[3]
OWN_WORDS = {"commissioning"}
"""Procedures for those who run the bench; their reports have English words."""
SYMBOL = re.compile(r"K[0a-z]*")
IN_TEMPLATE = re.compile(r'"([^"]+)"\|t\b')
PLACE = re.compile(r"\{\w+\}")
CHINESE = Texts("zh")


@cache
def words_of_the_code() -> str:
    """Return every text and name that stands in the code or in a template."""
    words: list[str] = []
    for room in ("station", "procedures", "sim_instruments", "drivers"):
        for path in (ROOT / room).rglob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            words.extend(str(getattr(node, "value", "")) for node in ast.walk(tree))
            words.extend(str(getattr(node, "id", "")) for node in ast.walk(tree))
    for path in (ROOT / "station" / "report").glob("*.j2"):
        words += IN_TEMPLATE.findall(path.read_text(encoding="utf-8"))
    return "\n".join(words) + "\n" + "\n".join(words).replace("_", " ")


def test_no_translation_is_one_of_a_text_that_nothing_uses() -> None:
    words = words_of_the_code()
    parts = {english: PLACE.split(english) for english in catalogue("zh", REPORT)}
    unused = [
        (english, part)
        for english, of in parts.items()
        for part in of
        if part.strip(" ,.:").removesuffix(" at") not in words
    ]
    assert unused == []


def test_every_flag_has_a_title_and_no_title_is_of_no_flag() -> None:
    page = (ROOT / "docs" / "reference" / "flags.md").read_text(encoding="utf-8")
    codes = set(re.findall(r"^\| `([a-z-]+)` \|", page.partition("## All flags")[2], re.MULTILINE))
    titles = catalogue("zh", FLAGS)
    assert codes - set(titles) == set()
    assert [code for code in titles if code not in words_of_the_code()] == []


def test_every_translation_shows_the_same_values() -> None:
    for english, other in catalogue("zh", REPORT).items():
        assert sorted(PLACE.findall(other)) == sorted(PLACE.findall(english)), english


def test_every_heading_of_the_report_is_translated() -> None:
    needed = {*PRINTED, *VERDICTS.values(), *DETAILS.values(), *RULES.values()}
    needed |= {words for _, words in BADGES.values()}
    for path in (ROOT / "station" / "report").glob("*.j2"):
        needed |= set(IN_TEMPLATE.findall(path.read_text(encoding="utf-8")))
    for file in ("certificate.py", "report_sheet.py"):
        tree = ast.parse((ROOT / "station" / "report" / file).read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Section":
                needed.add(str(ast.literal_eval(node.args[0])))
    for name in set(registry.names(registry.PROCEDURES)) - OWN_WORDS:
        procedure = procedure_of(name)
        results = (name.replace("_", " ") for name in procedure.results)
        needed |= {procedure.title, *(step.title for step in procedure.steps), *results}
    kept = {text for text in needed if SYMBOL.fullmatch(text)} | {"u", "U", "k"}
    assert sorted(text for text in needed - kept if CHINESE(text) == text) == []


@pytest.mark.parametrize(
    ("english", "chinese"),
    [
        ("Results", "测试结果"),
        ("bias at 20 degC", "零偏（20 degC）"),
        ("Kii at 26 degC", "Kii（26 degC）"),
        ("The output stood still at rest.", "The output stood still at rest."),
        (
            "Within limits. 2 results have a limit: 1 within, 1 outside.",
            "合格。2 项结果有限值：1 项合格，1 项不合格。",
        ),
        ("SN-0042", "SN-0042"),
        ("", ""),
    ],
)
def test_a_sentence_with_values_is_translated_and_an_unknown_is_not(
    english: str, chinese: str
) -> None:
    assert CHINESE(english) == chinese
    assert Texts("en")(english) == english
    both = Texts("zh+en")(english).splitlines()
    assert both == list(dict.fromkeys(text for text in (CHINESE(english), english) if text))


def a_sheet() -> Sheet:
    table = grid(("Quantity", "Value"), [("bias", "-1.5")])
    results = Section("Results", (pairs((("Model", "<RLG>"),)), table))
    return Sheet("Certificate", "Results", "n-1", "Lab", "Road", "", (results,), ("Draft me",))


def test_a_page_has_chinese_above_english_and_values_as_they_are() -> None:
    page = render_sheet(a_sheet().translated(Texts("zh+en")))
    assert "<h2>测试结果<br>Results</h2>" in page
    assert "零偏<br>bias" in page and "−1.5" in page and "&lt;RLG&gt;" in page
    assert 'lang="zh-CN"' in page
    assert "<h2>Results</h2>" in render_sheet(a_sheet())


def test_a_pdf_has_the_signs_of_its_language() -> None:
    from pypdf import PdfReader

    signs = {sign for sign in "测试结果零偏" if ord(sign) >= FIRST_IDEOGRAPH}
    try:
        font_with(signs)
    except InputError:
        if "STATION_FONT_REQUIRED" in os.environ:
            raise
        pytest.skip("no font with Chinese; install Debian's fonts-wqy-zenhei")
    import io

    reader = PdfReader(io.BytesIO(render_pdf(a_sheet().translated(Texts("zh")))))
    text = "".join(page.extract_text() for page in reader.pages)
    assert "测试结果" in text and "Draft me" in text
    with pytest.raises(InputError, match="fonts-wqy-zenhei"):
        font_with({"\U0001f9ff"})


def test_the_languages_of_a_report_are_those_of_the_contract() -> None:
    assert choices() == ("en", "zh", "zh+en")
