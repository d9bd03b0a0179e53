"""Which tests run a line: a plugin of pytest that labels coverage data, and what reads it again.

`python benchmarks/mutants.py cover` loads this file as a plugin. Each line that runs is labelled
with the test that ran it, in the processes that the test starts too: they take the label from the
environment. A test's line in `tests.jsonl` names the fixtures that it shares with others, because
only the first of them is seen to run what the fixture runs.
"""

from __future__ import annotations

import ast
import json
import os
import re
import statistics
import time
from collections import defaultdict
from collections.abc import Generator, Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import coverage
import pytest

TESTS = "MUTANTS_TESTS_FILE"
"""The variable of the environment that names the file of the tests' times."""
LEFT_OUT = "MUTANTS_LEFT_OUT_FILE"
"""The same for the file that names the tests to leave out, as a JUnit report names them."""
DATA, TIMES = "coverage.sqlite", "tests.jsonl"
FAILED: set[str] = set()
SAVED = [time.monotonic()]
SAVE_EVERY_S = 120.0
"""What was saved is not lost when the whole is stopped."""


def pytest_collection_modifyitems(config: Any, items: list[Any]) -> None:
    """Leave out the tests that the file names."""
    left_out = set(Path(os.environ[LEFT_OUT]).read_text(encoding="utf-8").splitlines())
    kept: list[Any] = []
    dropped: list[Any] = []
    for item in items:
        module, *classes = item.nodeid.partition("[")[0].split("::")[:-1]
        dotted = ".".join([module.removesuffix(".py").replace("/", "."), *classes])
        (dropped if f"{dotted}::{item.name}" in left_out else kept).append(item)
    items[:] = kept
    config.hook.pytest_deselected(items=dropped)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: Any) -> Generator[None, Any, Any]:
    """Label what runs from here on with the test, and write how long it took."""
    measured = coverage.Coverage.current()
    if measured is None:
        return (yield)
    measured.switch_context(item.nodeid)
    began = time.perf_counter()
    try:
        return (yield)
    finally:
        measured.switch_context("")
        line = {
            "test": item.nodeid,
            "seconds": round(time.perf_counter() - began, 3),
            "failed": item.nodeid in FAILED,
            "shares": sorted(_shared(item)),
        }
        with Path(os.environ[TESTS]).open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        if time.monotonic() > SAVED[-1] + SAVE_EVERY_S:
            measured.save()
            SAVED.append(time.monotonic())


def pytest_runtest_logreport(report: Any) -> None:
    """Remember a test that failed."""
    if report.failed:
        FAILED.add(report.nodeid)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish() -> None:
    """Save here: a process of pytest-xdist ends without the end of the interpreter."""
    measured = coverage.Coverage.current()
    if measured is not None:
        measured.stop()
        measured.save()


def _shared(item: Any) -> set[str]:
    fixtures = getattr(item, "_fixtureinfo", None)
    definitions = fixtures.name2fixturedefs if fixtures else {}
    return {
        f"{chosen[-1].baseid}::{name}"
        for name, chosen in definitions.items()
        if chosen[-1].scope != "function" and chosen[-1].baseid and not chosen[-1]._autouse
    }


class Covering:
    """What a folder of coverage data knows, of the code in `code`."""

    def __init__(self, folder: Path, code: Path) -> None:
        self._data = coverage.CoverageData(str(folder / DATA))
        self._data.read()
        self._code = code
        lines = (folder / TIMES).read_text(encoding="utf-8").splitlines()
        tests = [json.loads(line) for line in lines]
        self.seconds: dict[str, float] = {test["test"]: test["seconds"] for test in tests}
        self._shares: dict[str, list[str]] = {test["test"]: test["shares"] for test in tests}
        users: dict[str, list[float]] = defaultdict(list)
        for test in tests:
            for share in test["shares"]:
                users[share].append(test["seconds"])
        self._share_s = {
            share: max(0.0, seconds[0] - statistics.median(seconds[1:] or [0.0]))
            for share, seconds in users.items()
        }
        self._contexts: dict[str, dict[int, list[str]]] = {}
        self._roots = sorted({_root(name) for name in self._data.measured_files()} - {""})

    def tests_of(self, file: str, line: int) -> list[str]:
        """Return the tests that run a line of a file of the code, the most telling first.

        For a line that runs at import: the tests that run a line of a function that names what is
        set there, in this file or else in any; or else the tests that run this file at all. For a
        line that runs in no test that is known, and for a file of which no function runs: the
        tests of the same folder.
        """
        statement, inside, names = enclosing((self._code / file).read_text("utf-8"), line)
        if inside:
            direct = self._covering(file, statement)
        else:
            direct = self._of_import(file, statement, names)
        if not direct and self._by_line(file).keys() & set(statement):
            direct = self._of_folder(file)
        sharing = {share for test in direct for share in self._shares[test]}
        with_them = {test for test, shares in self._shares.items() if sharing & set(shares)}
        return [*self._spread(direct), *self._spread(with_them - direct)]

    def within(self, tests: Sequence[str], budget_s: float) -> list[str]:
        """Return the first tests that fit into a time, at least one, the quickest first.

        What a shared fixture takes, its first user's time above the others', counts once.
        """
        kept: list[str] = []
        spent_s, ready = 0.0, set[str]()
        for test in tests:
            shares = set(self._shares[test]) - ready
            own_s = max([self.seconds[test], *(self._share_s[share] for share in shares)])
            if not kept or spent_s + own_s <= budget_s:
                kept.append(test)
                spent_s += own_s
                ready |= shares
        return sorted(kept, key=self._alone_s)

    def _alone_s(self, test: str) -> float:
        return max([self.seconds[test], *(self._share_s[share] for share in self._shares[test])])

    def _of_import(self, file: str, statement: range, names: set[str]) -> set[str]:
        source = (self._code / file).read_text("utf-8")
        if names:
            tests = self._covering(file, lines_naming(source, names))
            if tests:
                return tests
            for other in self._files:
                text = (self._code / other).read_text("utf-8")
                if any(name in text for name in names):
                    tests |= self._covering(other, lines_naming(text, names))
            if tests:
                return tests
        body = lines_naming(source, None)
        in_statement = [row for row in body if row in statement]
        return self._covering(file, in_statement) or self._covering(file, body)

    def _of_folder(self, file: str) -> set[str]:
        for parent in Path(file).parents:
            tests = {test for test in self.seconds if test.startswith(f"tests/{parent}/")}
            if tests:
                return tests
        return set()

    def _covering(self, file: str, lines: Iterable[int]) -> set[str]:
        by_line = self._by_line(file)
        return {test for line in lines for test in by_line.get(line, ()) if test in self.seconds}

    def _by_line(self, file: str) -> dict[int, list[str]]:
        if file not in self._contexts:
            merged: dict[int, list[str]] = defaultdict(list)
            for root in self._roots:
                for line, labels in self._data.contexts_by_lineno(f"{root}{file}").items():
                    merged[line] += [_test_of(label) for label in labels]
            self._contexts[file] = merged
        return self._contexts[file]

    @cached_property
    def _files(self) -> list[str]:
        return sorted(
            {
                name.removeprefix(root)
                for name in self._data.measured_files()
                for root in self._roots
                if name.startswith(root)
                and name.endswith(".py")
                and (self._code / name.removeprefix(root)).is_file()
            }
        )

    def _spread(self, tests: Iterable[str]) -> list[str]:
        """Return tests so that each function's quickest come first, then each one's second."""
        functions: dict[str, list[str]] = defaultdict(list)
        for test in sorted(tests, key=lambda test: (self.seconds[test], test)):
            functions[test.partition("[")[0]].append(test)
        ranked = [
            (rank, self.seconds[test], test)
            for group in functions.values()
            for rank, test in enumerate(group)
        ]
        return [test for _, _, test in sorted(ranked)]


def _root(name: str) -> str:
    """Return the folder in which a measured file's package lies, with the slash."""
    packages = re.compile(r"^(.*?/)(?:station|drivers|procedures|sim_instruments)/")
    match = packages.match(name)
    return match[1] if match else ""


def _test_of(label: str) -> str:
    """Return the test in a label of coverage: `test`, or `test (call)` of a process it started."""
    return re.sub(r" \((setup|call|teardown)\)$", "", label.partition("|")[0])


def enclosing(source: str, line: int) -> tuple[range, bool, set[str]]:
    """Return the lines of the innermost statement, whether it is in a function, and what it sets.

    Of a statement that holds others the lines of its head; of a function all, since its defaults
    show only in calls.
    """
    chosen: ast.stmt | None = None
    inside = chosen_inside = False
    body: list[ast.stmt] = ast.parse(source).body
    while body:
        statement = next((one for one in body if _first(one) <= line <= _last(one)), None)
        if statement is None:
            break
        chosen, chosen_inside = statement, inside
        inside = inside or isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef)
        body = _inner(statement)
    if chosen is None:
        return range(line, line + 1), False, set()
    if isinstance(chosen, ast.FunctionDef | ast.AsyncFunctionDef):
        return range(chosen.body[0].lineno, _last(chosen) + 1), True, set()
    inner = [_first(statement) for statement in _inner(chosen)]
    end = min(inner) if inner else _last(chosen) + 1
    names = set() if chosen_inside else _targets(chosen)
    return range(chosen.lineno, max(end, chosen.lineno + 1)), chosen_inside, names


def _inner(statement: ast.stmt) -> list[ast.stmt]:
    parts: list[ast.stmt] = []
    for node in ast.iter_child_nodes(statement):
        if isinstance(node, ast.stmt):
            parts.append(node)
        elif isinstance(node, ast.ExceptHandler | ast.match_case):
            parts += node.body
    return parts


def _targets(statement: ast.stmt) -> set[str]:
    targets = statement.targets if isinstance(statement, ast.Assign) else []
    if isinstance(statement, ast.AnnAssign):
        targets = [statement.target]
    return {node.id for one in targets for node in ast.walk(one) if isinstance(node, ast.Name)}


def _first(statement: ast.stmt) -> int:
    decorators: list[ast.expr] = getattr(statement, "decorator_list", [])
    return min([statement.lineno, *(decorator.lineno for decorator in decorators)])


def _last(statement: ast.stmt) -> int:
    return statement.end_lineno or statement.lineno


def lines_naming(source: str, names: set[str] | None) -> list[int]:
    """Return the lines in the bodies of functions that hold one of the names; all lines if none."""
    rows: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            rows.update(range(node.body[0].lineno, _last(node) + 1))
    if names is None:
        return sorted(rows)
    wanted = re.compile(r"\b(" + "|".join(map(re.escape, sorted(names))) + r")\b")
    text = source.splitlines()
    return [row for row in sorted(rows) if wanted.search(text[row - 1])]
