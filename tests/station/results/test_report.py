"""The HTML report holds everything, invents nothing, and needs nothing beside it."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from procedures.rlg_magnetic_sensitivity.analysis import analyse
from procedures.rlg_magnetic_sensitivity.dataset import RlgDataset, Segment
from procedures.rlg_magnetic_sensitivity.evaluate import to_findings
from procedures.rlg_magnetic_sensitivity.figures import draw_parts
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from station.decision import Limit
from station.findings import Estimate, Findings, Flag, InputQuantity, Published
from station.parts import Part, Table
from station.plots import Plot
from station.report.context import (
    InstrumentRow,
    PromptRow,
    ReportContext,
    SafeStateRow,
    StepRow,
)
from station.report.html import render_html
from station.report.numbers import (
    align_decimals,
    format_duration,
    format_number,
    format_with_uncertainty,
)
from station.results import ResultDocument, conclude

NAME = "magnetic_sensitivity"
UNIT = "deg/h/mT"
SECTIONS = [
    "head",
    "simulated",
    "results",
    "published",
    "flags",
    "parts",
    "budget",
    "parameters",
    "steps",
    "instruments",
    "prompts",
    "safe-state",
    "assumptions",
    "notes",
    "versions",
]


class Page(HTMLParser):
    """What a reader of the page sees, and what the page refers to."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.tags: set[str] = set()
        self.references: list[str] = []
        self.alternatives: list[str] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(html)
        self.text = re.sub(r"\s+", " ", " ".join(self.words))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag not in {"meta", "img"}:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id" and tag in {"section", "header"}:
                self.ids.append(value or "")
            if name in {"src", "href"}:
                self.references.append(value or "")
            if name == "alt":
                self.alternatives.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.words.append(data)


def a_document(**changes: object) -> ResultDocument:
    estimates = [
        Estimate(NAME, "IA", 0.04523, UNIT, 0.00311, 240.0, "least-squares", {"gain": -0.045}),
        Estimate(NAME, "NA", -0.1161, UNIT, 0.0032, 240.0, "least-squares", {"gain": 0.116}),
        Estimate(NAME, "LA", None, UNIT, None, None, "least-squares"),
    ]
    published = [
        Published(NAME, "IA", 0.04491, UNIT, "dft-peak"),
        Published(NAME, "NA", 0.1158, UNIT, "dft-peak"),
        Published(NAME, "LA", None, UNIT, "dft-peak"),
    ]
    flags = [Flag("not-identifiable", "LA is undetermined: <b>no field</b> & no answer.", "LA")]
    inputs = [InputQuantity("gain", "gaussmeter range", 0.005, "1", "certificate 4711")]
    limits = {(NAME, axis): Limit(max_abs=0.1) for axis in ("IA", "NA", "LA")}
    findings = Findings(estimates, published, flags, inputs, None)
    return conclude(
        "rlg-magnetic-sensitivity",
        findings,
        changes.get("limits", limits),  # type: ignore[arg-type]
        "guarded",
    )


def a_context() -> ReportContext:
    return ReportContext(
        title="Laser gyro: magnetic sensitivity",
        source="a published method, S1 to S9",
        started_utc="2026-03-01T10:00:00+00:00",
        ended_utc="2026-03-01T10:40:00+00:00",
        operator="Ada <script>alert(1)</script>",
        dut={"model": "RLG-50", "serial": "SN & 0042"},
        decision_rule="guarded",
        plan_name="acceptance",
        parameters=[("frequency", "0.1 Hz"), ("slope", "-0.5 deg/h")],
        bench_name="bench 1",
        simulated=True,
        simulation=["The gyro was simulated."],
        instruments=[
            InstrumentRow(
                "gaussmeter", "field", "Lake Shore F71", "1", "2", "4711", "2026-01-01", True
            )
        ],
        steps=[StepRow("S1", "Mount the gyro", 0.0, 12.5, "done")],
        prompts=[PromptRow("mount", "Mount it.", "done", "simulated world")],
        safe_state=[SafeStateRow("coil_supply.x", False, "no answer", 0.5)],
        assumptions=["The coils were not moved."],
        versions=[("Python", "3.11")],
        reproduce="station analyse RUN",
        notes=["A note."],
    )


def a_table() -> Table:
    return Table("A table", "Of two rows.", ["what", "how much"], [["a", "-1.25"], ["b", "3"]])


def a_gyro_record(axes: tuple[str, ...] = ("IA",)) -> RlgDataset:
    """A short record with a line that anybody can see, spikes and a gap; no noise generator."""
    np = pytest.importorskip("numpy")
    index = np.delete(np.arange(1200), slice(500, 520))
    time_s = (index + 0.5) * 0.1
    drive = {axis: Drive(0.1 + 0.07 * n, 1.0) for n, axis in enumerate(axes)}
    field = np.tile([0.02, -0.01, 0.03], (len(time_s), 1))
    for axis, sine in drive.items():
        field[:, ("IA", "NA", "LA").index(axis)] += np.sin(2 * np.pi * sine.frequency_Hz * time_s)
    noise = np.sin(index * 12.9898) * 43758.5453
    rate = 9.6 + field @ [0.5, -0.3, 0.2] + 0.1 * (noise - np.floor(noise) - 0.5)
    rate[[100, 700]] += [50.0, -50.0]
    return RlgDataset((Segment(drive, 0.1, time_s, rate, 0.0, time_s, field, 0.0),))


def test_every_section_is_there_in_order() -> None:
    page = Page(render_html(a_document(), a_context(), [a_table()]))
    assert page.ids == SECTIONS
    assert page.open == []


def test_what_is_empty_is_left_out() -> None:
    document = replace(a_document(), flags=[], published=[])
    page = Page(render_html(document, ReportContext("An imported dataset"), []))
    assert page.ids == ["head", "results", "budget", "assumptions"]


def drawn(dataset: RlgDataset) -> tuple[Part, ...]:
    findings = to_findings(analyse(dataset), dataset, [], [])
    return draw_parts(findings, conclude("rlg-magnetic-sensitivity", findings, {}, "simple"))


def test_the_page_needs_nothing_beside_it() -> None:
    parts = drawn(a_gyro_record())
    html = render_html(a_document(), a_context(), parts)
    page = Page(html)
    assert page.references and all(r.startswith("data:image/png;base64,") for r in page.references)
    assert not {"script", "link", "iframe", "a"} & page.tags
    assert not re.search(r"https?:|url\(|@import|file:", html)


def test_every_picture_says_what_it_shows() -> None:
    parts = drawn(a_gyro_record())
    page = Page(render_html(a_document(), a_context(), parts))
    plots = [part for part in parts if isinstance(part, Plot)]
    assert len(page.alternatives) == len(plots) == 6
    for text, plot in zip(page.alternatives, plots, strict=True):
        assert plot.title in text and plot.caption in text


def test_texts_from_outside_are_escaped() -> None:
    html = render_html(a_document(), a_context(), [a_table()])
    assert "<script" not in html and "&lt;script&gt;" in html
    assert "SN &amp; 0042" in html
    assert "&lt;b&gt;no field&lt;/b&gt; &amp; no answer" in html


def test_values_have_the_digits_of_their_uncertainty() -> None:
    text = Page(render_html(a_document(), a_context(), [])).text
    assert re.search(r"IA 0\.0452 0\.0031 1\.97 0\.0061 24\d deg/h/mT \|value\| ≤ 0\.1", text)
    assert "NA −0.1161 0.0033" in text


def test_an_undetermined_result_says_so() -> None:
    page = Page(render_html(a_document(), a_context(), []))
    assert "LA undetermined – – – – deg/h/mT" in page.text
    assert "not-identifiable" in page.text


def test_the_verdict_stands_in_plain_words() -> None:
    text = Page(render_html(a_document(), a_context(), [])).text
    assert "Outside a limit 3 results have a limit: 1 within, 1 outside, 1 undecided." in text
    assert "Guarded acceptance" in text
    none = Page(render_html(a_document(limits={}), a_context(), [])).text
    assert "No limit asked for" in none


def test_an_unverified_safe_state_is_told_beside_the_verdict() -> None:
    context = replace(a_context(), bench_safe=False)
    text = Page(render_html(a_document(), context, [])).text
    assert "safe state was not verified" in text and "coil_supply.x not verified" in text


def test_a_simulated_run_is_called_simulated() -> None:
    context = a_context()
    assert "no real device was measured" in Page(render_html(a_document(), context, [])).text
    real = replace(context, simulated=False, simulation=())
    assert "simulated" not in Page(render_html(a_document(), real, [])).ids


def test_the_published_value_stands_beside_the_best_one() -> None:
    text = Page(render_html(a_document(), a_context(), [])).text
    assert "IA 0.0449 0.0452 −0.0003 −0.1 deg/h/mT dft-peak" in text
    assert "LA undetermined undetermined – – deg/h/mT" in text


def test_the_shares_of_a_budget_add_up() -> None:
    document = a_document()
    text = Page(render_html(document, a_context(), [])).text
    assert "gaussmeter range B" in text and "certificate 4711" in text
    combined = document.results[0].combined
    assert combined is not None
    shares = [line.contribution**2 for line in combined.budget]
    assert math.isclose(sum(shares), combined.standard_uncertainty**2, rel_tol=1e-9)
    assert f"{100 * shares[0] / sum(shares):.1f}" in text


def test_no_number_on_the_page_is_infinite_or_not_a_number() -> None:
    parts = drawn(a_gyro_record(("IA", "NA")))
    text = Page(render_html(a_document(), a_context(), parts)).text
    assert not re.search(r"\b(nan|inf|None)\b", text, re.IGNORECASE)


def test_the_same_inputs_give_the_same_bytes() -> None:
    dataset = a_gyro_record()
    pages = [render_html(a_document(), a_context(), drawn(dataset)) for _ in range(2)]
    assert pages[0] == pages[1]


def test_a_record_without_a_field_is_still_drawn() -> None:
    dataset = a_gyro_record()
    dead = replace(dataset.segments[0], field_mT=dataset.segments[0].field_mT * 0.0)
    parts: tuple[Part, ...] = drawn(RlgDataset((dead,)))
    assert "undetermined" in Page(render_html(a_document(), a_context(), parts)).text


@pytest.mark.parametrize(
    ("value", "uncertainty", "expected"),
    [
        (0.04523, 0.00311, ("0.0452", "0.0031")),
        (-0.1, 0.0996, ("-0.10", "0.10")),
        (-0.0004, 0.031, ("0.000", "0.031")),
        (12345.6, 321.0, ("12350", "320")),
        (1.5, 0.0, ("1.50000", "0")),
        (3.2e-9, 1.1e-10, ("3.20e-9", "0.11e-9")),
        (9.998e-7, 9.998e-7, ("1.0e-6", "1.0e-6")),
        (None, None, ("undetermined", "–")),
        (math.nan, 1.0, ("undetermined", "–")),
        (1.23456, None, ("1.235", "–")),
    ],
)
def test_value_and_uncertainty_end_at_the_same_place(
    value: float | None, uncertainty: float | None, expected: tuple[str, str]
) -> None:
    assert format_with_uncertainty(value, uncertainty) == expected


def test_numbers_alone_keep_their_digits() -> None:
    assert format_number(0.99996, 4) == "1.000"
    assert format_number(123456.0, 3) == "123000"
    assert format_number(1.5e-7, 2) == "1.5e-7"
    assert format_number(0.0) == "0"


def test_decimal_points_stand_in_line() -> None:
    padded = align_decimals(["1.25", "-3", "undetermined"])
    assert padded == ["1.25", "-3\u2008\u2007\u2007", "undetermined"]


def test_durations_read_as_a_person_says_them() -> None:
    assert [format_duration(s) for s in (3.14, 125.0, 7260.0, None)] == [
        "3.1 s",
        "2 min 05 s",
        "2 h 01 min",
        "–",
    ]
