"""The plots of a finished run on its page: what the report has, as Plotly takes it."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Page, chromium
from panel_server import Served, panel
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement

from station.panel.figures import figure_of
from station.parts import parts_of_text
from station.plots import (
    Arrow,
    Axis,
    Band,
    Cells,
    Ellipse,
    Item,
    Line,
    Note,
    Panel,
    Plot,
    Points,
    Region,
    Rule,
    Scale,
    Steps,
)
from station.record.folder import PLOTS

X = [1.0, 2.0, 4.0]
KINDS: tuple[Item, ...] = (
    Line(X, [1.0, math.nan, 3.0], dashes="--", label="a < b"),
    Points(X, X, bars=X, bars_x=X, fill="none", joined=1.0, label="a < b"),
    Points(X, X, values=X, marker="x"),
    Band(X, X, X, colour=0.5),
    Rule(y=0.0, label="rule"),
    Rule(x=1.0),
    Region(x=(1.0, 2.0)),
    Region(x=(1.0, 2.0), y=(0.0, 1.0)),
    Ellipse(1.0, 1.0, 0.5, 0.5),
    Steps([0.0, 1.0, 2.0], [1.0, 2.0], sideways=True),
    Note(0.5, 0.5, "note", inside=True, slanted=True, boxed=True),
    Note(1.0, 1.0, "note"),
    Arrow(1.0, 1.0, 2.0, 2.0),
    Cells([[1.0, math.nan]]),
)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, one_axis_run: Path) -> Iterator[Served]:
    runs = tmp_path_factory.mktemp("panel")
    shutil.copytree(one_axis_run, runs / one_axis_run.name)
    with panel(runs) as one:
        yield one


def figure(*items: Item, **look: object) -> dict[str, object]:
    plot = Plot("A", "B", (Panel(items, scale=Scale(0.0, 1.0), **look),))  # type: ignore[arg-type]
    return json.loads(json.dumps(figure_of(plot), allow_nan=False))  # type: ignore[no-any-return]


def test_every_kind_of_item_is_data_that_json_can_hold() -> None:
    made = figure(*KINDS, legend="above", legend_columns=3)
    traces, layout = made["data"], made["layout"]
    assert isinstance(traces, list) and isinstance(layout, dict)
    assert len(traces) == 6 and len(layout["shapes"]) == 5 and len(layout["annotations"]) == 3
    assert traces[0]["y"] == [1.0, None, 3.0] and traces[0]["line"]["dash"] == "dash"
    assert traces[0]["name"] == "a &lt; b"
    assert [trace["showlegend"] for trace in traces] == [True, *[False] * 5]
    assert layout["legend"]["orientation"] == "h"


def test_ranges_of_logarithmic_axes_and_of_dates_are_those_of_plotly() -> None:
    layout = figure(Line(X, X), x=Axis(log=True, low=1.0, high=100.0), y=Axis(dates=True, low=1.0))[
        "layout"
    ]
    assert isinstance(layout, dict)
    assert layout["xaxis"]["range"] == [0.0, 2.0] and layout["xaxis"]["type"] == "log"
    assert layout["yaxis"]["range"][0] == 86_400_000.0


def test_panels_stand_side_by_side_and_share_an_axis() -> None:
    panels = (
        Panel((Line(X, X),), title="One", y=Axis("volts")),
        Panel((Line(X, [5.0] * 3),), column=1, y=Axis(room=0.5)),
    )
    plot = Plot("A", "B", panels, widths=(2.0, 1.0), gap_x=0.1, share_y="row")
    layout = figure_of(plot)["layout"]
    left, right = (layout[name]["domain"] for name in ("xaxis", "xaxis2"))
    assert left[0] == 0.0 and right[1] == pytest.approx(1.0) and left[1] < right[0]
    assert (left[1] - left[0]) / (right[1] - right[0]) == pytest.approx(2.0)
    assert layout["yaxis2"]["matches"] == "y" and not layout["yaxis2"]["showticklabels"]
    assert layout["yaxis"]["range"] == layout["yaxis2"]["range"]
    assert layout["yaxis"]["range"][0] < 1.0 and layout["yaxis"]["range"][1] > 6.0


def test_a_run_s_plots_are_served_as_its_report_has_them(
    served: Served, one_axis_run: Path
) -> None:
    status, text = served.get(f"/api/run/{one_axis_run.name}/plots")
    assert status == 200
    parts = parts_of_text((one_axis_run / PLOTS).read_text(encoding="utf-8"))
    plots = [part.title for part in parts if isinstance(part, Plot)]
    assert plots and [entry["title"] for entry in json.loads(text)] == plots
    status, text = served.get(f"/api/run/{one_axis_run.name}/plots", Cookie="station-language=zh")
    assert status == 200 and [entry["title"] for entry in json.loads(text)] != plots


def test_a_run_without_plots_and_plots_that_were_altered_are_said_to_be_that(
    served: Served, one_axis_run: Path
) -> None:
    folder = served.runs / f"{one_axis_run.name}-2"
    shutil.copytree(one_axis_run, folder)
    file = folder / PLOTS
    file.write_text(file.read_text(encoding="utf-8").replace("deg", "rad"), encoding="utf-8")
    status, text = served.get(f"/api/run/{folder.name}/plots")
    assert status == 409 and "station verify" in json.loads(text)["error"]
    file.unlink()
    assert served.get(f"/api/run/{folder.name}/plots")[0] == 404


def test_the_page_of_a_finished_run_draws_its_plots(served: Served, one_axis_run: Path) -> None:
    driver = chromium()
    try:
        page = Page(driver)
        driver.get(f"{served.url}/run/{one_axis_run.name}")

        def drawn() -> list[WebElement]:
            return driver.find_elements(By.CSS_SELECTOR, "#own-plots .plot:has(.main-svg)")

        page.wait(lambda: len(drawn()) >= 5)
        plots = drawn()
        assert all(plot.get_attribute("aria-label") for plot in plots)
        assert page.accessibility_findings() == []
    finally:
        driver.quit()
