"""The panel in a real browser: start, prompts, plots, pause, abort, a dead run, a lost panel."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from browser import Page, chromium
from command_line import PLAN
from panel_server import Served, begin, free_port, panel
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select
from served_bench import served_bench

from station.control.channel import ask
from station.control.status import read_status
from station.errors import StationError
from station.record.run_names import runs_below


@pytest.fixture(scope="module")
def driver() -> Iterator[object]:
    one = chromium()
    yield one
    one.quit()


@pytest.fixture
def page(driver: object) -> Page:
    return Page(driver)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A panel with one short released plan beside those of the station."""
    place = tmp_path_factory.mktemp("panel")
    plans = place / "config" / "plans"
    plans.mkdir(parents=True)
    (plans / "short.yaml").write_text(PLAN + "released: true\n", encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        patch.delenv("CI", raising=False)
        with panel(place / "runs") as one:
            yield one
            for run in runs_below(one.runs):
                try:
                    ask(run, "abort", 60.0)
                except StationError:
                    continue


def home(page: Page, served: Served) -> None:
    """Open the first page, and wait until it is filled."""
    page.driver.get(served.url)
    page.wait(lambda: page.element("plan").find_elements(By.TAG_NAME, "option"))
    page.wait(lambda: page.element("serial").is_displayed())


def start(page: Page, served: Served, serial: str) -> Path:
    """Start the short plan as an operator does: the serial number is scanned first."""
    home(page, served)
    Select(page.element("plan")).select_by_value("short")
    Select(page.element("bench")).select_by_value("sim")
    page.element("serial").send_keys(serial, Keys.ENTER)
    page.wait_for("look-steps", "Mount the gyro")
    assert page.accessibility_findings() == []
    page.click("start")
    page.wait(lambda: "/run/" in page.driver.current_url)
    page.wait_for("prompt-text", "Mount the gyro")
    return served.runs / page.driver.current_url.rsplit("/", 1)[1]


def answered(page: Page, asked: str) -> bool:
    """Whether a prompt waits no more."""
    return page.text("prompt-text") != asked or bool(page.text("verdict"))


@pytest.mark.campaign
def test_no_ends_the_run_with_a_safe_bench(page: Page, served: Served) -> None:
    run = start(page, served, "SN-NO")
    page.driver.switch_to.active_element.send_keys("SN-SCANNED", Keys.ENTER)  # answers nothing
    page.wait(lambda: page.element("answer-done").is_enabled())
    assert page.element("prompt").is_displayed()
    assert page.accessibility_findings() == []
    page.click("answer-abort")
    page.wait_for("notice", "did not finish")
    page.wait_for("safe", "verified")
    assert page.accessibility_findings() == []
    assert "NOT VERIFIED" not in page.text("safe")
    assert read_status(run).bench_safe
    page.wait_for("to-do", "resume the run")
    page.click("resume")
    page.wait_for("prompt-text", "The run goes on where it stopped")
    page.click("answer-abort")
    page.wait_for("notice", "did not finish")


@pytest.mark.campaign
def test_yes_to_every_prompt_leads_to_results(page: Page, served: Served) -> None:
    start(page, served, "SN-YES")
    picture = page.element("prompt-picture")
    assert int(picture.get_attribute("naturalWidth")) > 0
    assert "nothing is energised yet" in page.text("prompt-then")
    ticked, plots = 0, page.element("plots")
    while not page.text("verdict"):
        if not page.element("prompt").is_displayed():
            continue
        asked = page.text("prompt-text")
        if boxes := page.driver.find_elements(By.CSS_SELECTOR, "#prompt-checklist input"):
            assert not page.element("answer-done").is_enabled()
            assert page.accessibility_findings() == []
            for box in boxes:
                box.click()
            ticked += len(boxes)
        page.click("answer-done")
        page.wait(partial(answered, page, asked))
    assert ticked == 2
    assert page.accessibility_findings() == []
    assert page.text("verdict") == "✔ PASS: within every limit"
    assert "magnetic sensitivity IA" in page.text("results")
    assert "simulated" in page.text("flags")
    report = page.element("report").get_attribute("href")
    assert served.get(report.removeprefix(served.url))[0] == 200
    assert int(plots.get_attribute("data-plots")) >= 2
    assert 1 < int(plots.get_attribute("data-points")) <= 600


@pytest.mark.campaign
def test_two_viewers_see_the_same_and_a_reload_loses_nothing(page: Page, served: Served) -> None:
    start(page, served, "SN-TWO")
    first, text = page.driver.current_window_handle, page.text("prompt-text")
    page.driver.switch_to.new_window("tab")
    page.driver.get(served.url)
    page.wait_for("runs", "SN-TWO")
    page.driver.find_element(By.PARTIAL_LINK_TEXT, "SN-TWO").click()
    page.wait_for("prompt-text", text)
    page.click("answer-done")
    page.wait(lambda: page.text("prompt-text") not in ("", text))
    assert not page.element("answer-done").is_enabled()  # the second click of a pair
    page.driver.switch_to.window(first)
    page.wait(lambda: page.text("prompt-text") not in ("", text))
    before = page.text("prompt-text")
    page.driver.refresh()
    page.wait_for("prompt-text", before)
    page.click("answer-abort")
    page.wait_for("notice", "did not finish")
    (other,) = set(page.driver.window_handles) - {first}
    page.driver.switch_to.window(other)
    page.driver.close()
    page.driver.switch_to.window(first)


def test_an_abort_is_sent_from_the_last_of_many_tabs(page: Page, served: Served) -> None:
    start(page, served, "SN-TABS")
    first, run = page.driver.current_window_handle, page.driver.current_url
    for _ in range(6):
        page.driver.switch_to.new_window("tab")
        page.driver.get(run)
        page.wait_for("prompt-text", "Mount the gyro")
    page.click("abort")
    page.wait_for("notice", "did not finish", 10.0)
    for other in set(page.driver.window_handles) - {first}:
        page.driver.switch_to.window(other)
        page.driver.close()
    page.driver.switch_to.window(first)


def test_a_look_is_of_what_stands_in_the_form_and_a_scan_starts_nothing(
    page: Page, served: Served
) -> None:
    home(page, served)
    Select(page.element("plan")).select_by_value("short")
    Select(page.element("bench")).select_by_value("sim")
    page.element("serial").send_keys("SN-A", Keys.ENTER, "B")
    page.wait_for("look-said", "changed meanwhile")
    assert not page.element("look").is_displayed()
    page.element("serial").send_keys(Keys.ENTER)
    page.wait_for("look-steps", "Mount the gyro")
    page.driver.switch_to.active_element.send_keys("SN-C", Keys.ENTER)
    assert "begins" not in page.text("look-said")


def test_what_a_person_types_is_shown_as_text(page: Page, served: Served) -> None:
    start(page, served, "SN&lt;b&gt;1")
    assert "SN&lt;b&gt;1" in page.text("run-title")
    page.click("abort")
    page.wait_for("notice", "did not finish")
    home(page, served)
    page.element("serial").send_keys("<img src=x onerror=alert(1)>", Keys.ENTER)
    page.wait_for("look-said", "names the run folder and may not hold")
    assert page.text("look-said").startswith("serial: ")
    assert not page.driver.find_elements(By.CSS_SELECTOR, "img")


@pytest.mark.campaign
def test_a_plot_moves_a_pause_holds_and_a_killed_run_is_shown(
    page: Page, served: Served, tmp_path: Path
) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text(PLAN.replace("SN-1", "SN-KILLED"), encoding="utf-8")
    with served_bench(tmp_path, speed=5.0) as (at, _):  # it still runs when it is killed
        command = [sys.executable, "-m", "station", "run", str(plan), "--served", str(at)]
        process = subprocess.Popen(
            [*command, "--non-interactive", "--output", str(served.runs)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            page.driver.get(served.url)
            page.wait_for("runs", "SN-KILLED")
            page.driver.find_element(By.PARTIAL_LINK_TEXT, "SN-KILLED").click()
            page.wait_for("sentence", "running")
            page.wait(lambda: page.element("plots").get_attribute("data-last"))

            def last() -> float:
                return float(page.element("plots").get_attribute("data-last"))

            before = last()
            page.wait(lambda: last() > before)
            page.wait_for("tiles", "coil supply x · current")
            page.wait_for("tiles", "mT")
            page.wait_for("tiles", "°/h")
            page.wait_for("interlocks", "✔ chain")
            assert page.accessibility_findings() == []
            os.kill(process.pid, signal.SIGKILL)
            page.wait_for("notice", "STATION ERROR")
            page.wait_for("notice", "made the bench safe")
            page.wait_for("safe", "verified")
        finally:
            process.kill()
            process.wait()


@pytest.mark.campaign
def test_a_panel_that_is_gone_is_said_and_comes_back(
    page: Page, served: Served, one_axis_run: Path
) -> None:
    shutil.copytree(one_axis_run, served.runs / one_axis_run.name)
    port = free_port()
    other = begin(served.runs, port)
    page.driver.get(f"{other.url}/run/{one_axis_run.name}")
    page.wait_for("connection", "connected")
    other.stop()
    page.wait_for("connection", "CONNECTION LOST", 6.0)
    again = begin(served.runs, port)
    page.wait_for("connection", "connected")
    again.stop()
