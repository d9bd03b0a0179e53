"""Figures in documents are those of a benchmark's stored output, whose lines say of which commit.

A comment before a table or a paragraph names them, and no reader sees it:

    <!-- figures: rlg_estimator: bound best_rmse_over_bound standard_error coverage_95% -->

names the file in `benchmarks/figures`, and of each case, which is a row of the table, the values in
the order in which they stand behind the row's first cell; `%` shows a share in per cent, and `~`
stands for a blank in a name. Of some cases only, or in front of a paragraph, the cases are named:

    <!-- figures: run_time "serf-nonorthogonality": bench_s processor_s -->
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from figures import FOLDER, lines_of, stored
from places import ROOT

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
COMMAND = re.compile(r"benchmarks/(\w+)\.py")
CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
MARKER = re.compile(r'<!--\s*figures:\s*(\w+)((?:\s+"[^"]+")*)\s*:([^>]*?)-->\n+')
NUMBER = re.compile(r"(?<![\w.,])[-−+]?\d+(?:,\d{3})*(?:\.\d+)?(?:·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?")
RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
NOT_YET_STORED: dict[str, dict[str, str]] = {
    "docs/decisions/0001-one-participant-at-a-time.md": {
        "1. Virtual time runs one participant at a time": "run_time.py --plan PLAN --own-threads"
    },
    "docs/explanations/records.md": {
        "Units of work": "kill_campaign.py --virtual 50 --scaled 20",
        "Memory": "memory_evaluation.py --hours 10",
    },
    "docs/explanations/safety-contract.md": {"What was measured": "fault_campaign.py"},
    "docs/explanations/safety.md": {"The guardian": "guardian.py --kills 12 --stops 3 --doubles 9"},
    "docs/explanations/simulated-world.md": {"What is assumed": "recovery.py --seeds 40"},
    "docs/how-to/evaluate-many-runs-again.md": {"On a cluster": "reanalysis.py --runs 1000"},
    "docs/how-to/first-day-on-hardware.md": {
        "What is verified and what is not": "commissioning.py"
    },
    "docs/how-to/run-the-tests.md": {"What the tests are worth": "suite.py"},
    "docs/procedures/accelerometer-magnetic-sensitivity.md": {
        "Planted faults": "sabotage.py --procedure accelerometer-magnetic-sensitivity",
        "An encoder that is off": "accelerometer_encoder.py",
        "How good it is": "accelerometer_estimator.py --runs 2000",
    },
    "docs/procedures/fog-scale-factor-temperature.md": {
        "What the data cannot show": "sabotage.py --procedure fog-scale-factor-temperature",
        "A run": "fog_kills.py --kills 10 --seeds 1 2 3 4 5 6",
        "How good it is": "fog_estimator.py --runs 2000",
    },
    "docs/procedures/gyro-bias-temperature.md": {
        "How good it is": "bias_temperature_estimator.py --runs 60"
    },
    "docs/procedures/gyro-static-noise.md": {
        "What it is worth": "gyro_static_estimator.py --runs 2000"
    },
    "docs/procedures/nine-axis-calibration.md": {
        "How good it is": "nine_axis_estimator.py --runs 2000",
        "Planted faults": "sabotage.py --procedure nine-axis-calibration",
    },
    "docs/procedures/rlg-magnetic-sensitivity.md": {
        "What the data deny": "sabotage.py --procedure rlg-magnetic-sensitivity",
        "How good it is": "rlg_estimator.py --runs 2000",
        "Three coils at once, and records that end by themselves": "rlg_modes.py",
    },
    "docs/procedures/serf-nonorthogonality.md": {
        "How good it is": "serf_estimator.py --runs 2000",
        "Planted faults": "sabotage.py --procedure serf-nonorthogonality",
    },
}
"""Sections, by page, whose figures are older than the place to store them, each with its command.

Store the output, mark the figures, and take the section out; none is added."""


@dataclass(frozen=True)
class Section:
    """A part of a document between two headings."""

    page: str
    heading: str
    text: str


@dataclass(frozen=True)
class Figures:
    """What a marker says, and the table or paragraph that it stands before."""

    benchmark: str
    cases: tuple[str, ...]
    names: tuple[str, ...]
    block: str

    @property
    def is_table(self) -> bool:
        return self.block.startswith("|")

    def rows(self) -> list[str]:
        """Return what holds the figures of each case."""
        if not self.is_table:
            return [self.block]
        return [row.split("|", 2)[2] for row in self.block.splitlines()[2:]]

    def values(self) -> list[list[float]]:
        """Return the stored values of each case, as they are shown."""
        lines = stored(self.benchmark)
        chosen = self.cases or tuple(lines)
        if not self.is_table:
            return [[value for case in chosen for value in self._of(lines[case])]]
        return [self._of(lines[case]) for case in chosen]

    def _of(self, line: dict[str, Any]) -> list[float]:
        shown = []
        for name in self.names:
            value = float(line[name.removesuffix("%").replace("~", " ")])
            shown.append(100.0 * value if name.endswith("%") else value)
        return shown


def sections(page: Path) -> Iterator[Section]:
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    headings = [*HEADING.finditer(text)]
    ends = [*(match.start() for match in headings), len(text)]
    for heading, (begin, end) in zip(headings, pairwise(ends), strict=True):
        yield Section(page.relative_to(ROOT).as_posix(), heading.group(1), text[begin:end])


def figures_in(text: str) -> Iterator[Figures]:
    for match in MARKER.finditer(text):
        benchmark, cases, names = match.groups()
        block = text[match.end() :].split("\n\n", 1)[0]
        named = tuple(re.findall(r'"([^"]+)"', cases))
        yield Figures(benchmark, named, tuple(names.split()), block)


def tables_in(text: str) -> list[str]:
    """Return the tables of a text that have a number behind the first cell of a row."""
    blocks = [block.strip() for block in text.split("\n\n")]
    tables = [block[block.index("|") :] for block in blocks if re.search(r"^\|", block, re.M)]
    return [table for table in tables if re.search(r"^\|[^|]*\|.*\d", table, re.M)]


def numbers_in(text: str) -> list[tuple[float, float]]:
    """Return each number of a text, and by how much it may be rounded."""
    found = []
    for match in NUMBER.finditer(text):
        digits, _, power = match.group().replace("−", "-").replace(",", "").partition("·10")
        size = 10.0 ** int(power.translate(RAISED)) if power else 1.0
        decimals = len(digits.partition(".")[2])
        zeros = 0 if "." in digits else len(digits) - len(digits.rstrip("0") or "0")
        found.append((float(digits) * size, 0.5 * 10.0 ** (zeros - decimals) * size * (1 + 1e-6)))
    return found


def faults_of(figures: Figures) -> Iterator[str]:
    """Yield what of marked figures is not what is stored."""
    rows, stored_rows = figures.rows(), figures.values()
    if len(rows) != len(stored_rows):
        yield f"{len(rows)} rows, {len(stored_rows)} cases are stored"
    for row, values in zip(rows, stored_rows, strict=False):
        shown = numbers_in(row)
        if figures.is_table:
            if len(shown) != len(values):
                yield f"{len(shown)} figures in {row!r}, {len(values)} are named"
            pairs = list(zip(shown, values, strict=False))
            for (number, half), value in pairs:
                if abs(number - value) > half:
                    yield f"{number:g} in {row!r}, {value:g} is stored"
            continue
        place = 0
        for value in values:  # other numbers may stand between them
            while place < len(shown) and abs(shown[place][0] - value) > shown[place][1]:
                place += 1
            if place == len(shown):
                yield f"{value:g} is stored, and not in {row!r}"
                break
            place += 1


def name_of(section: Section) -> tuple[str, str]:
    return section.page, section.heading


SECTIONS = [section for page in PAGES for section in sections(page)]
MEASURED = [section for section in SECTIONS if COMMAND.search(section.text)]


def is_marked(section: Section) -> bool:
    """Whether figures of each benchmark that a section names are marked, and each table is."""
    marked = list(figures_in(section.text))
    tables = sum(figures.is_table for figures in marked)
    named = set(COMMAND.findall(section.text)) <= {figures.benchmark for figures in marked}
    return named and tables == len(tables_in(section.text))


def test_marked_figures_are_those_of_the_stored_output() -> None:
    wrong = {
        name_of(section): faults
        for section in SECTIONS
        if (faults := [each for found in figures_in(section.text) for each in faults_of(found)])
    }
    assert not wrong


def test_figures_of_a_benchmark_are_marked() -> None:
    unmarked = {name_of(section) for section in MEASURED if not is_marked(section)}
    known = {(page, heading) for page, of_page in NOT_YET_STORED.items() for heading in of_page}
    new = unmarked - known
    assert not new, "name the stored figures in a comment before them; the module says how"
    done = known - unmarked
    assert not done, "take them out of NOT_YET_STORED: marked, or gone"


def test_every_command_that_is_to_be_stored_is_one_of_ours() -> None:
    commands = [command for of_page in NOT_YET_STORED.values() for command in of_page.values()]
    named = {command.split()[0] for command in commands}
    assert named <= {path.name for path in (ROOT / "benchmarks").glob("*.py")}


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.jsonl")), ids=lambda file: file.stem)
def test_every_stored_line_says_of_which_commit_it_is_and_when_and_how_it_was_made(
    file: Path,
) -> None:
    for line in lines_of(file):
        assert re.fullmatch(r"[0-9a-f]{10,40}", line["commit"]), line
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", line["date"]), line
        assert line["command"].startswith(f"python benchmarks/{file.stem}.py"), line
        assert re.fullmatch(r"\d+ cores, .+", line["machine"]), line
        assert "/" not in line["machine"], line


def test_a_figure_that_differs_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("figures.FOLDER", tmp_path)
    lines = [{"case": "a", "x": 0.98449, "part": 0.953}, {"case": "b", "x": 21432.0, "part": 0.5}]
    text = "\n".join(json.dumps(line) for line in lines)
    (tmp_path / "made.jsonl").write_text(text, encoding="utf-8")

    def faults(block: str, head: str = "made: x part%") -> list[str]:
        (figures,) = figures_in(f"<!-- figures: {head} -->\n{block}\n\nMore 7.\n")
        return list(faults_of(figures))

    table = "| case | x | part |\n|---|---|---|\n| 3 a | {} | {} % |\n| b | {} | 50 % |"
    assert not faults(table.format("0.984", "95.3", "21,432"))
    assert not faults(table.format("0.98", "95", "2.14·10⁴"))
    assert faults(table.format("0.985", "95.3", "21,432"))
    assert faults(table.format("0.984", "95.4", "21,432"))
    assert faults(table.format("0.984", "95.3", "21,433"))
    assert faults(table.format("0.984 ± 0.1", "95.3", "21,432"))
    assert faults(table.format("0.984", "95.3", "21,432") + "\n| c | 1 | 2 |")
    assert not faults("Of 12 runs 0.984 and 95 %.", 'made "a": x part%')
    assert faults("Of 12 runs 0.983 and 95 %.", 'made "a": x part%')
    assert faults("Of 12 runs 95 % and 0.984.", 'made "a": x part%')
