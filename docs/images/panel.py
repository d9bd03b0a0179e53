"""Take the pictures of the panel that the docs show: `PYTHONPATH=. python docs/images/panel.py`.

Needs Chromium with its driver, and the packages of the tests.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(DOCS.parent / "tests" / "support"))

from browser import Page, chromium  # noqa: E402
from panel_server import panel  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import Select  # noqa: E402

from station.clock import RealClock  # noqa: E402

WIDTH, HEIGHT = 1280, 800


def main() -> None:
    """Start a run of the laser gyro's plan, answer its prompts, and look at each state."""
    os.environ.pop("CI", None)
    with tempfile.TemporaryDirectory() as place, panel(Path(place) / "runs") as served:
        page = Page(chromium())
        try:
            page.driver.get(served.url)
            page.wait(lambda: page.element("serial").is_displayed())
            Select(page.element("plan")).select_by_value("rlg-magnetic-sensitivity")
            page.element("serial").send_keys("SN-0042", Keys.ENTER)
            page.wait_for("look-steps", "Mount the gyro")
            take(page, "panel-start", 1250)
            page.click("start")
            page.wait_for("prompt-text", "Mount the gyro")
            take(page, "panel-prompt")
            shown = False
            while not page.text("verdict"):
                if page.element("prompt").is_displayed():
                    asked = page.text("prompt-text")
                    for box in page.driver.find_elements("css selector", "#prompt-checklist input"):
                        box.click()
                    page.click("answer-done")
                    page.wait(lambda asked=asked: page.text("prompt-text") != asked)
                if not shown and "set " in page.text("tiles"):
                    take(page, "panel-live")
                    shown = True
            take(page, "panel-results", 1300)
        finally:
            page.driver.quit()


def take(page: Page, name: str, height: int = HEIGHT) -> None:
    """Write what the browser shows."""
    metrics = {"width": WIDTH, "height": height, "deviceScaleFactor": 1, "mobile": False}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    RealClock().sleep(1.0)
    page.driver.save_screenshot(str(DOCS / "images" / f"{name}.png"))


if __name__ == "__main__":
    main()
