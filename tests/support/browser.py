"""A real Chromium without a screen, and what a test looks for on a page."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from typing import Any

import pytest
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

WITHIN_S = 60.0
REQUIRED = "STATION_BROWSER_REQUIRED"
"""Where it is set, as in CI, a browser that is not there fails the tests."""


def chromium() -> webdriver.Chrome:
    """Return a browser of Debian's Chromium; the test is skipped where there is none."""
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        what = "Chromium and its driver are not installed (Debian: chromium, chromium-driver)"
        if os.environ.get(REQUIRED):
            pytest.fail(what)
        pytest.skip(what)
    options = Options()
    options.binary_location = program
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.add_argument("--window-size=1200,1400")
    return webdriver.Chrome(options=options, service=Service(driver))


class Page:
    """A page of the panel in a browser."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def element(self, name: str) -> Any:
        """Return the element of an id."""
        return self.driver.find_element(By.ID, name)

    def text(self, name: str) -> str:
        """Return the text that a person sees in an element."""
        text: str = self.element(name).text
        return text

    def wait(self, what: Callable[[], object], within_s: float = WITHIN_S) -> None:
        """Wait until something holds."""
        wait = WebDriverWait(
            self.driver,
            within_s,
            poll_frequency=0.05,
            ignored_exceptions=[StaleElementReferenceException],
        )
        wait.until(lambda _: what())

    def wait_for(self, name: str, text: str, within_s: float = WITHIN_S) -> None:
        """Wait until an element shows a text."""
        self.wait(lambda: text in self.text(name), within_s)

    def accessibility_findings(self) -> list[str]:
        """Return what axe finds wrong with the page: labels, contrast, focus, headings."""
        from axe_core_python.selenium import Axe

        found = Axe().run(self.driver)["violations"]
        return [f"{one['id']}: {node['html']}" for one in found for node in one["nodes"]]

    def click(self, name: str) -> None:
        """Press a button, once it can be pressed."""
        self.wait(lambda: self.element(name).is_displayed() and self.element(name).is_enabled())
        self.element(name).click()
