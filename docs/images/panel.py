"""Take the pictures of the panel that the docs show: `PYTHONPATH=. python docs/images/panel.py`.

Each state of the panel, in each language, of simulated runs. Needs Chromium with its driver, and
the packages of the tests. A folder as argument takes the pictures instead of this one.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "support"))

from browser import Page, chromium  # noqa: E402
from guardian_helpers import world  # noqa: E402
from panel_server import Served, panel  # noqa: E402
from PIL import Image  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import Select  # noqa: E402

from station.cli.attaching import begin_detached  # noqa: E402
from station.clock import RealClock  # noqa: E402
from station.control.channel import ask  # noqa: E402
from station.control.run_reader import RunReader  # noqa: E402
from station.texts import languages  # noqa: E402

WIDTH, HEIGHT = 1280, 800
PLAN, SERIAL = "rlg-magnetic-sensitivity", "SN-0042"
SPEED = 20.0
SHORTER = (
    *("--set", "parameters.duration=150 s"),
    *("--set", "parameters.warm_up.at_most=4 min"),
    *("--set", "parameters.warm_up.window=1 min"),
    *("--set", "parameters.warm_up.slope_limit=40 deg/h^2"),
)
"""What is shown of a run that takes real time, and would take too much of it."""
COLOURS = 128
"""A page has few colours; so a picture takes a third of the room."""
NO_LIMIT_HOLDS = "limits.magnetic_sensitivity.max_abs=0.02 deg/h/mT"


class Camera:
    """A browser that looks at one panel in every language."""

    def __init__(self, page: Page, served: Served, pictures: Path) -> None:
        self.page, self._served, self._pictures = page, served, pictures

    def take(self, state: str, path: str, ready: str, wanted: int = 1, serial: str = "") -> None:
        """Write what the panel shows, once so many elements of a selector are seen.

        A serial number is typed first, and looked at.
        """
        driver = self.page.driver
        for language in languages():
            driver.get(self._served.url)
            driver.execute_script(f"document.cookie = 'station-language={language}; path=/'")
            driver.execute_script("localStorage.setItem('station-theme', 'light')")
            driver.get(self._served.url + path)
            if serial:
                self.page.wait(lambda: self._seen("#plan option"))
                Select(self.page.element("plan")).select_by_value(PLAN)
                self.page.element("serial").send_keys(serial, Keys.ENTER)
            self.page.wait(lambda: self._seen(ready) >= wanted)
            RealClock().sleep(1.5)
            name = f"panel-{state}" + ("" if language == "en" else f"-{language}")
            file = self._pictures / f"{name}.png"
            driver.save_screenshot(str(file))
            with Image.open(file) as picture:
                picture.convert("RGB").quantize(COLOURS).save(file, optimize=True)
            print(file, file.stat().st_size)

    def _seen(self, selector: str) -> int:
        found = self.page.driver.find_elements("css selector", selector)
        return sum(element.is_displayed() for element in found)


def main() -> None:
    """Bring the bench into each state, and look at it."""
    os.environ.pop("CI", None)
    pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE
    with tempfile.TemporaryDirectory() as place, panel(Path(place) / "runs") as served:
        os.environ["XDG_STATE_HOME"] = place  # an interlock trips here, and on no bench of the user
        page = Page(chromium())
        metrics = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
        page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        camera = Camera(page, served, pictures)
        try:
            of_virtual_runs(camera, served.runs)
            of_live_runs(camera, served.runs, Path(place))
            camera.take("home", "/", "#runs tr", 4)
            camera.take("start", "/", "#look-steps li", 5, SERIAL)
        finally:
            page.driver.quit()


def begin(runs: Path, *options: str) -> Path:
    """Begin a run of the laser gyro's plan, and return its folder."""
    return begin_detached(["run", PLAN, "--serial", SERIAL, "--output", str(runs), *options])


def of_virtual_runs(camera: Camera, runs: Path) -> None:
    """Look at a run that asks, that was aborted, and at one outside its limits."""
    run = begin(runs, "--rehearse")
    camera.take("prompt", f"/run/{run.name}", "#prompt")
    ask(run, "abort", 60.0)
    camera.take("aborted", f"/run/{run.name}", "#to-do li, #to-do p")
    run = begin(runs, "--non-interactive", "--set", NO_LIMIT_HOLDS)
    camera.take("fail", f"/run/{run.name}", "#results .bullet", 3)


def wait_for_units(run: Path, units: int) -> None:
    """Wait until a run has recorded so many units of work."""
    reader = RunReader(run)
    while (state := reader.state())["units_done"] < units:
        assert state["state"] != "failed", state["message"]
        RealClock().sleep(0.2)
        reader.read()


def of_live_runs(camera: Camera, runs: Path, place: Path) -> None:
    """Look at a run that goes on and passes, and at one that an interlock ends."""
    with world(place, SPEED, "sim", PLAN) as bench:
        served = ("--non-interactive", *SHORTER, "--served", str(bench.head))
        run = begin(runs, *served)
        wait_for_units(run, 1)
        camera.take("live", f"/run/{run.name}", "#plots .trace")
        wait_for_units(run, 3)
        camera.take("pass", f"/run/{run.name}", "#results .bullet", 3)
        run = begin(runs, *served)
        wait_for_units(run, 1)
        bench.inject(instrument="interlock_chain", fault="chain-open", contact="door")
        camera.take("trip", f"/run/{run.name}", "#to-do li, #to-do p")


if __name__ == "__main__":
    main()
