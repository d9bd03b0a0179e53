"""Each page of a procedure has a table of its steps: where in the code, which test, what differs.

In the column `where` a file stands before the functions of it, in the procedure's package or below
`procedures`; in the column `test` a file before its tests, in the procedure's tests or elsewhere
below `tests`. `…` stands for the part of a test's name that is left out.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

import pytest
from places import ROOT

from station.procedure import Procedures

PAGES = sorted((ROOT / "docs" / "procedures").glob("*.md"))
COLUMNS = ("step", "where", "test")
WHY = "what differs, and why"
PUT_OFF = re.compile(r"\bnot (?:yet )?(?:done|implemented)\b|\btodo\b", re.IGNORECASE)
SPAN = re.compile(r"`([^`]+)`")


def rows_of(page: Path) -> Iterator[dict[str, str]]:
    """Yield the rows of the tables of a page that have steps, each cell under its column."""
    head: list[str] = []
    for line in page.read_text(encoding="utf-8").splitlines():
        if not line.startswith("|"):
            head = []
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not head:
            head = cells
        elif head[0].startswith("step") and not set(line) <= set("|- "):
            assert len(cells) == len(head), f"{page.name}: {line}"
            yield {"step": cells[0], **dict(zip(head[1:], cells[1:], strict=True))}


@cache
def names_in(file: Path) -> frozenset[str]:
    """Return what a file defines: functions, classes and, behind their class, methods."""
    names: set[str] = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            inner = [part for part in node.body if isinstance(part, ast.FunctionDef)]
            names |= {f"{node.name}.{part.name}" for part in inner}
    return frozenset(names)


def missing(cell: str, own: Path, top: Path) -> Iterator[str]:
    """Yield what a cell names and no file has."""
    file: Path | None = None
    for word in SPAN.findall(cell):
        if word.endswith(".py"):
            places = [own / word, top / word, *sorted(top.rglob(word))]
            file = next((place for place in places if place.is_file()), None)
            if file is None:
                yield word
        elif file is None or not any(
            fnmatchcase(name, word.replace("…", "*")) for name in names_in(file)
        ):
            yield f"{word} in {file and file.name}"


def test_every_procedure_with_steps_of_a_method_has_a_page() -> None:
    plain = {name for name in Procedures() if name != "commissioning"}
    assert {page.stem for page in PAGES} == plain


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_step_stands_in_the_table_of_its_page(page: Path) -> None:
    told = " ".join(row["step"] for row in rows_of(page)).split()
    steps = [step.number for step in Procedures()[page.stem].steps]
    assert [number for number in told if number in steps] == steps


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_table_of_steps_names_is_there(page: Path) -> None:
    package = page.stem.replace("-", "_")
    for row in rows_of(page):
        where, test = row["where"], row["test"]
        assert SPAN.search(where), f"{page.name}: {row['step']} names no function"
        assert SPAN.search(test), f"{page.name}: {row['step']} names no test"
        assert row[WHY], f"{page.name}: {row['step']} does not say what differs"
        wrong = [
            *missing(where, ROOT / "procedures" / package, ROOT / "procedures"),
            *missing(test, ROOT / "tests" / "procedures" / package, ROOT / "tests"),
        ]
        assert not wrong, f"{page.name}: {row['step']}: {wrong}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_line_of_a_page_puts_a_step_off(page: Path) -> None:
    for line in page.read_text(encoding="utf-8").splitlines():
        assert not PUT_OFF.search(line), line
