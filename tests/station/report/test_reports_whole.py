"""Reports and certificates of the shipped procedures in Chinese: no English sentence is left."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from html.parser import HTMLParser
from pathlib import Path

import pytest
from short_forms import SHORT_FORMS
from tiers import quick

from station.procedure import procedure_of
from station.record.folder import read_run
from station.report.certificate import certificate_of_run, sheet_of
from station.report.run_report import context_of_run, report_of_run
from station.report.sheet_html import render_sheet
from station.runner.evaluation import evaluate_run
from station.texts import Texts

ENGLISH_WORDS = re.compile(r"(?<![\w./_-])(?:[A-Za-z][a-z']+ ){2,}[a-z']{2,}")
"""Three words that follow one another, the last in small letters."""
WITHIN_A_TEXT = {"b", "br", "em", "i", "span", "strong", "sub", "sup"}
NOT_READ = ("style", "code", "pre")


class Read(HTMLParser):
    """The texts that a person reads on a page; ids and commands are none."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts, self._text, self._hidden = [""], "", 0
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begin a text, or what is no text; a picture has one beside it."""
        self._hidden += tag in NOT_READ
        if tag not in WITHIN_A_TEXT or tag == "br":
            self.texts.append("")
        self.texts += [str(value) for name, value in attrs if name == "alt"] + [""] * bool(attrs)

    def handle_endtag(self, tag: str) -> None:
        """End a text, or what is no text."""
        self._hidden -= tag in NOT_READ
        if tag not in WITHIN_A_TEXT:
            self.texts.append("")

    def handle_data(self, data: str) -> None:
        """Go on with a text."""
        if not self._hidden:
            self.texts[-1] += data


def in_english(page: str, names: Iterable[str]) -> list[str]:
    """Return the texts of a page that have English words, but for names of what is cited."""
    named = re.compile("|".join(map(re.escape, names)) or "$")
    texts = (" ".join(named.sub("", text).split()) for text in Read(page).texts)
    return [text for text in dict.fromkeys(texts) if ENGLISH_WORDS.search(text)]


@pytest.mark.parametrize("plan", quick(SHORT_FORMS, "serf-nonorthogonality"))
def test_no_english_is_left_in_a_chinese_report_or_certificate(
    plan: str, run_of: Callable[[str], Path]
) -> None:
    folder, texts = read_run(run_of(plan)), Texts("zh")
    document, findings = evaluate_run(folder)
    procedure = procedure_of(document.procedure)
    names = [procedure.source, *(row.model for row in context_of_run(folder).instruments)]
    names = [name for name in names if name]
    page = report_of_run(folder, document, procedure.report(findings, document), texts)
    sheet = sheet_of(certificate_of_run(folder, document)).translated(texts)
    assert '<html lang="zh-CN">' in page
    assert in_english(page, names) == []
    assert in_english(render_sheet(sheet), names) == []


def test_english_is_seen() -> None:
    page = "<p>测试 <b>the</b> gyro stands still</p><code>a b c d</code><td>KEPCO BOP 36-12</td>"
    assert in_english(page, []) == ["测试 the gyro stands still"]
    assert in_english("<p>依据：A long name of it</p>", ["A long name of it"]) == []
