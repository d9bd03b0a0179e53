"""The languages of the panel: no text without its translation, none that nothing uses."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser

import pytest
from browser import Page, chromium
from panel_server import Served, panel
from selenium.webdriver.support.ui import Select

from station.panel.app import PAGES
from station.record.run_state import SENTENCES
from station.roles.role import roles
from station.texts import ENGLISH, PANEL, catalogue, languages, preferred

CALL = re.compile(r'\bt\("((?:[^"\\]|\\.)*)"')
PLACE = re.compile(r"\{(\w+)\}")


class Words(HTMLParser):
    """The texts of a page that a person reads."""

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found |= {value for name, value in attrs if name in ("aria-label", "title") and value}

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.found.add(data.strip())


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with panel(tmp_path_factory.mktemp("panel")) as one:
        yield one


@pytest.fixture
def page() -> Iterator[Page]:
    one = chromium()
    yield Page(one)
    one.quit()


def used() -> set[str]:
    """Return the English texts of the pages, of their scripts and of the states of a run."""
    found = set(SENTENCES.values())
    for path in PAGES.glob("*.html"):
        words = Words()
        words.feed(path.read_text(encoding="utf-8"))
        found |= words.found
    for path in PAGES.glob("*.js"):
        found |= set(CALL.findall(path.read_text(encoding="utf-8")))
    return found


def of_instruments() -> set[str]:
    """Return the words of roles, their quantities and states, and of what is recorded."""
    quantities = [named for declared in roles().values() for named in declared.quantities.items()]
    words = {*roles(), *(name for name, _ in quantities), "counts", "resistance"}
    words |= {state for _, quantity in quantities for state in quantity.states}
    return {word.replace("_", " ") for word in words}


@pytest.mark.parametrize("language", [one for one in languages() if one != ENGLISH])
def test_no_text_is_missing_and_none_is_unused(language: str) -> None:
    texts = catalogue(language, PANEL)
    needed = used() | of_instruments()
    assert needed - set(texts) == set()
    assert set(texts) - needed == set()
    assert all(text.strip() for text in texts.values())
    for english, other in texts.items():  # the same values are shown
        assert sorted(PLACE.findall(other)) == sorted(PLACE.findall(english))


@pytest.mark.parametrize(
    ("wishes", "language"),
    [
        ("", "en"),
        ("zh-CN,zh;q=0.9,en;q=0.8", "zh"),
        ("en-GB,zh;q=0.5", "en"),
        ("de, zh;q=0.3", "zh"),
        ("zh;q=0, fr", "en"),
        ("zh;q=much", "en"),
    ],
)
def test_a_browser_gets_the_first_language_that_there_is(wishes: str, language: str) -> None:
    assert preferred(wishes) == language


def test_the_choice_on_the_page_goes_before_the_wish_of_the_browser(served: Served) -> None:
    path = "/static/texts.js"
    assert 'LANGUAGE = "zh"' in served.get(path, **{"Accept-Language": "zh-CN"})[1]
    _, script = served.get(path, **{"Accept-Language": "zh-CN", "Cookie": "station-language=en"})
    assert 'LANGUAGE = "en"' in script and "const TEXTS = {};" in script
    _, script = served.get(path, Cookie="station-language=../zh")
    assert 'LANGUAGE = "en"' in script
    _, script = served.get(path, Cookie="station-language=zh")
    texts = re.search(r"TEXTS = (.*);\n", script)
    assert texts is not None and json.loads(texts[1]) == catalogue("zh", PANEL)


@pytest.mark.campaign
def test_a_language_is_chosen_and_remembered(page: Page, served: Served) -> None:
    page.driver.get(served.url)
    page.wait_for("start-title", "Start a run")
    Select(page.element("language")).select_by_value("zh")
    page.wait_for("start-title", catalogue("zh", PANEL)["Start a run"])
    page.driver.get(served.url)
    page.wait_for("connection", "操作员")
    assert page.text("start-title") == catalogue("zh", PANEL)["Start a run"]
    assert page.driver.execute_script("return document.documentElement.lang") == "zh-CN"
    assert page.accessibility_findings() == []
    Select(page.element("language")).select_by_value("en")
    page.wait_for("start-title", "Start a run")
