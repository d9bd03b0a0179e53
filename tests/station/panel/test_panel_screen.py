"""What a person sees of the panel: it fits the screen, speaks their language, keeps the focus."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from browser import Page, chromium
from command_line import PLAN
from panel_server import Served, panel
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from served_bench import served_bench

from station.record.run_names import runs_below, serial_of
from station.record.series import RunSeries

DESK, PHONE, WALL = (1280, 800), (390, 844), (3840, 2160)
WITHIN = "return [document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
TOOK = "return document.querySelector('#steps .done .took').textContent"
DRAWN = "return document.getElementById('plots').data.map((line) => [line.name, line.y])"


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    driver = chromium()
    yield Page(driver)
    driver.quit()


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, one_axis_run: Path) -> Iterator[Served]:
    """A panel on one finished run."""
    runs = tmp_path_factory.mktemp("panel") / "runs"
    runs.mkdir()
    subprocess.run(["cp", "-r", str(one_axis_run), str(runs)], check=True)
    with panel(runs) as shown:
        yield shown


def size(page: Page, pixels: tuple[int, int]) -> None:
    """Give the page the size of a screen."""
    metrics = {"width": pixels[0], "height": pixels[1], "deviceScaleFactor": 1, "mobile": False}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


def extent(page: Page) -> tuple[int, int]:
    """Return how wide and how high the page is, in pixels."""
    width, height = page.driver.execute_script(WITHIN)
    return int(width), int(height)


def speak(page: Page, served: Served, language: str) -> None:
    """Choose a language for this browser."""
    page.driver.get(served.url)
    page.driver.execute_script(f"document.cookie = 'station-language={language}; path=/'")


def home(page: Page, served: Served, **asked: str) -> None:
    """Open the first page, and wait until it is filled."""
    page.driver.get(f"{served.url}/?{urlencode(asked)}")
    page.wait(lambda: page.element("plan").find_elements(By.TAG_NAME, "option"))
    page.wait(lambda: page.element("serial").is_displayed())


def focused(page: Page) -> str:
    """Return the id of the element that has the focus."""
    return str(page.driver.switch_to.active_element.get_attribute("id"))


def press(page: Page, keys: str, apart_s: float) -> None:
    """Press keys with times between them that do not depend on how busy the machine is."""
    begin_s = time.time()
    for number, key in enumerate(keys):
        at_s = begin_s + number * apart_s
        pressed = {"text": key, "key": "Enter" if key == "\r" else key, "timestamp": at_s}
        page.driver.execute_cdp_cmd("Input.dispatchKeyEvent", {"type": "keyDown", **pressed})
        page.driver.execute_cdp_cmd("Input.dispatchKeyEvent", {"type": "keyUp", **pressed})


def test_a_scan_goes_into_the_serial_number_whatever_the_page_is_doing(
    page: Page, served: Served
) -> None:
    home(page, served)
    assert focused(page) == "serial"
    page.driver.execute_script("document.activeElement.blur()")
    page.driver.switch_to.active_element.send_keys("SN-77")
    assert page.element("serial").get_attribute("value") == "SN-77"
    page.driver.execute_script("document.activeElement.blur()")
    page.driver.switch_to.active_element.send_keys("SN-78")  # never "SN-77SN-78"
    assert page.element("serial").get_attribute("value") == "SN-78"
    page.element("plan").send_keys("SN-79", Keys.ENTER, "SN-80")  # who chose a plan just now, too
    assert page.element("serial").get_attribute("value") == "SN-80"
    page.element("serial").send_keys(Keys.CONTROL, "a", Keys.NULL, "SN-78")
    page.element("search").send_keys("0042")  # who writes elsewhere goes on there
    assert page.element("serial").get_attribute("value") == "SN-78"


@pytest.mark.parametrize("field", ["serial", "search", "operator"])
def test_a_scan_sets_the_serial_number_alone_wherever_a_click_went_before(
    page: Page, served: Served, field: str
) -> None:
    home(page, served)
    page.element("serial").send_keys("SN-1")
    if field != "serial":
        page.element(field).send_keys("Li")
    page.click(field)
    press(page, "SN-2\r", apart_s=0.01)
    page.wait(lambda: page.element("serial").get_attribute("value") == "SN-2")
    if field != "serial":
        assert page.element(field).get_attribute("value") == "Li"
    page.wait_for("look-title", "SN-2")


@pytest.mark.parametrize("field", ["serial", "search", "operator"])
def test_what_a_person_types_stays_where_it_is_typed(
    page: Page, served: Served, field: str
) -> None:
    home(page, served)
    page.element(field).send_keys("SN-1")
    press(page, "SN-2\r", apart_s=0.1)
    assert page.element(field).get_attribute("value") == "SN-1SN-2"


def test_serial_numbers_of_a_list_follow_one_another(page: Page, served: Served) -> None:
    home(page, served)
    page.element("serial").send_keys("SN-1 SN-2 SN-3")
    assert page.driver.execute_script("return wanted().serial") == "SN-1"
    page.driver.execute_script("sessionStorage.setItem('station-serials', '[\"SN-2\", \"SN-3\"]')")
    run = next(iter(runs_below(served.runs))).name
    page.driver.get(f"{served.url}/run/{run}")
    page.wait_for("again", "Next: SN-2, 1 more after it")
    page.click("again")
    page.wait(lambda: page.element("serial").get_attribute("value") == "SN-2 SN-3")
    page.driver.execute_script("sessionStorage.clear()")


def test_plans_stand_by_their_titles_and_only_those_that_may_be_started(
    page: Page, served: Served
) -> None:
    home(page, served, plan="gyro-static-noise")
    options = [option.text for option in page.element("plan").find_elements(By.TAG_NAME, "option")]
    assert "Acceptance test, three axes (rlg-magnetic-sensitivity)" in options
    assert page.element("plan").get_attribute("value") == "gyro-static-noise"
    page.wait_for("benches", "calibration due in")


@pytest.mark.campaign
@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("theme", ["light", "dark", "contrast"])
def test_every_look_and_language_of_both_pages_can_be_read(
    page: Page, served: Served, language: str, theme: str
) -> None:
    speak(page, served, language)
    page.driver.execute_script(f"localStorage.setItem('station-theme', '{theme}')")
    run = next(iter(runs_below(served.runs))).name
    for path in ("/", f"/run/{run}"):
        page.driver.get(served.url + path)
        page.wait_for(
            "runs" if path == "/" else "results",
            serial_of(served.runs / run) if path == "/" else "IA",
        )
        for pixels in (DESK, PHONE, WALL):
            size(page, pixels)
            assert extent(page)[0] <= pixels[0], (path, pixels)
            assert page.accessibility_findings() == [], (path, pixels)
    page.driver.execute_script("localStorage.removeItem('station-theme')")
    speak(page, served, "en")
    size(page, DESK)


def test_a_result_stands_in_the_band_of_its_limits(page: Page, served: Served) -> None:
    run = next(iter(runs_below(served.runs))).name
    page.driver.get(f"{served.url}/run/{run}")
    page.wait_for("results", "magnetic sensitivity IA")
    page.wait_for("to-do", "Switch the device off before you take it out")
    (bullet,) = page.driver.find_elements(By.CSS_SELECTOR, "#results .bullet")
    assert "within |x| ≤ 0.1" in str(bullet.get_attribute("aria-label"))


def test_a_gyro_that_gives_nothing_any_more_is_shown_with_the_age_of_its_last_value(
    page: Page, served: Served
) -> None:
    run = next(iter(runs_below(served.runs))).name
    page.driver.get(f"{served.url}/run/{run}")
    page.wait_for("verdict", "PASS")
    columns = {"rate_deg/h": {"t": [1.0, 2.0], "v": [9.6, 9.7]}}
    series = {"source": "gyro_acquisition", "unit": "deg/h", "device": True, "columns": columns}
    live = {"instruments": [], "interlocks": [], "time_s": 102.0}
    tile = "return document.querySelector('.tile').textContent"
    page.driver.execute_script("showPlots([arguments[0]]); showLive(arguments[1])", series, live)
    assert "1 min 40 s ago" in page.driver.execute_script(tile)
    page.driver.execute_script("showLive(arguments[0])", {**live, "time_s": 3.0})
    assert "ago" not in page.driver.execute_script(tile)
    page.driver.execute_script("output = null; showLive(arguments[0])", live)
    assert "no newer value" in page.driver.execute_script(tile)


def test_a_bench_of_which_something_is_not_known_is_not_called_safe(
    page: Page, served: Served
) -> None:
    run = next(iter(runs_below(served.runs))).name
    page.driver.get(f"{served.url}/run/{run}")
    page.wait_for("to-do", "the bench is safe, read back from every instrument that can harm")
    for rest, words in (
        ({"known": False, "sentence": "NOT KNOWN to be safe: table"}, "switch off by hand"),
        (None, "Nobody has read the bench back"),
    ):
        page.driver.execute_script("toDo({...shown, rest: arguments[0]})", rest)
        assert words in page.text("to-do")
        assert "Switch the device off" not in page.text("to-do")


def test_the_certificate_of_a_run_is_made_when_it_is_asked_for(served: Served) -> None:
    run = next(iter(runs_below(served.runs)))
    status, text = served.get(f"/api/run/{run.name}/certificate")
    assert (status, text[:5]) == (200, "%PDF-")
    assert (run / "exports" / "certificate.pdf").is_file()


def test_the_results_of_a_device_are_drawn_from_run_to_run(page: Page, served: Served) -> None:
    home(page, served)
    page.wait(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#runs button"))
    page.driver.execute_script("document.querySelector('#runs button').click()")
    page.wait_for("trend", "magnetic sensitivity IA")
    assert len(page.driver.find_elements(By.CSS_SELECTOR, "#trend circle")) == 1


@pytest.mark.campaign
def test_a_live_run_fits_the_desk_and_shows_what_matters(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No scrolling at 1280 x 800; tiles, plots up to the sine's peak, steps with their times."""
    monkeypatch.setenv("CI", "true")
    plan = tmp_path / "plan.yaml"
    plan.write_text(PLAN, encoding="utf-8")
    with served_bench(tmp_path, speed=20.0) as (at, _), panel(tmp_path / "runs") as served:
        command = [sys.executable, "-m", "station", "run", str(plan), "--served", str(at)]
        process = subprocess.Popen(
            [*command, "--non-interactive", "--output", str(served.runs)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            size(page, DESK)
            home(page, served)
            page.wait_for("runs", "SN-1")
            page.driver.execute_script("document.querySelector('#runs a').click()")
            page.wait_for("tiles", "gaussmeter · field")
            page.wait_for("tiles", "°/h")
            page.wait(lambda: field_peak_mT(page) > 0.9)
            assert extent(page) == DESK
            for name in ("abort", "pause", "left", "ends", "tiles", "plots", "steps", "interlocks"):
                box = page.element(name).rect
                assert box["height"] > 0 and box["y"] + box["height"] <= DESK[1], name
            assert "counts" not in page.text("tiles")
            assert page.driver.find_elements(By.CSS_SELECTOR, "#tiles .near b")
            took = page.driver.execute_script(TOOK)  # at once: the list is drawn again and again
            assert took.endswith("s")
            assert page.accessibility_findings() == []
            page.wait_for("verdict", "PASS", 120.0)
            assert process.wait(60.0) == 0
        finally:
            process.kill()
            process.wait()
        series = RunSeries(next(iter(runs_below(served.runs))))
        series.look()
        recorded_mT = 1e3 * max(most for _, name, (_, _, most) in series.ranges() if name == "x_T")
        page.wait(lambda: field_peak_mT(page) == pytest.approx(recorded_mT, rel=0.02))


def field_peak_mT(page: Page) -> float:
    """Return the largest field that is drawn; 0 where none is yet."""
    drawn: list[tuple[str, list[Any]]] = page.driver.execute_script(DRAWN) or []
    values = [value for name, line in drawn if "mT" in name for value in line if value is not None]
    return float(np.max(np.abs(values), initial=0.0))
