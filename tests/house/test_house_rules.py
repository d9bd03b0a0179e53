"""Who may import whom, who may ask the operating system for the time, and what names may be."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from places import ROOT

ROOMS = ("station", "drivers", "procedures", "sim_instruments", "config")
SOURCES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
CLOCK = ("time.sleep", "time.time", "time.monotonic", "time.perf_counter", "datetime.now")
WORDS = "station.findings"
"""What analyses say it in, which imports no more than they may."""
ANALYSIS = {"__future__", "collections", "dataclasses", "math", "typing", "numpy", "scipy"}


@cache
def parsed(path: Path) -> ast.Module:
    """Return what a file says, read once; nobody may change it."""
    return ast.parse(path.read_text(encoding="utf-8"))


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def import_statements(path: Path) -> list[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Return every import of a file, and whether it is for types alone."""
    found: list[tuple[ast.Import | ast.ImportFrom, bool]] = []
    waiting: list[tuple[ast.AST, bool]] = [(parsed(path), False)]
    while waiting:
        node, typing = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.append((node, typing))
        elif not isinstance(node, ast.expr):
            test = node.test if isinstance(node, ast.If) else None
            typing = typing or (isinstance(test, ast.Name) and test.id == "TYPE_CHECKING")
            waiting += [(child, typing) for child in ast.iter_child_nodes(node)]
    return found


def imports(path: Path, *, typing_too: bool = True, deep: bool = False) -> Iterator[str]:
    """Yield what a file imports; `deep`: a module named behind `import`, not its package."""
    package = module_of(path) if path.name == "__init__.py" else module_of(path).rpartition(".")[0]
    for node, typing in import_statements(path):
        if typing and not typing_too:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            base = package.split(".")[: len(package.split(".")) - node.level + 1]
            name = ".".join(
                [*(base if node.level else []), *([node.module] if node.module else [])]
            )
            inside = [f"{name}.{alias.name}" for alias in node.names]
            yield from [part if part in MODULES else name for part in inside] if deep else [name]


MODULES = {module_of(path) for path in SOURCES}


def within(module: str, *rooms: str) -> bool:
    return any(module == room or module.startswith(room + ".") for room in rooms)


def allowed(importer: str, imported: str) -> bool:
    """Whether a module of one room may import a module of our own."""
    room = importer.split(".")[0]
    if within(imported, room) and not within(importer, "procedures"):
        return True
    if within(importer, "procedures"):
        own = ".".join(importer.split(".")[:2])
        shared = ("procedures.common", "procedures.estimation", "station")
        return within(imported, own, *shared)
    if within(importer, "drivers"):
        return within(
            imported,
            "station.clock",
            "station.roles",
            "station.units",
            "station.fields",
            "station.errors",
        )
    if within(importer, "sim_instruments"):
        return within(imported, "station.clock", "station.units")
    return False


def test_a_room_imports_only_what_it_may() -> None:
    for path in SOURCES:
        importer = module_of(path)
        ours = [name for name in imports(path) if within(name, *ROOMS)]
        broken = [name for name in ours if not allowed(importer, name)]
        assert not broken, f"{importer} may not import {broken}"


def test_no_maker_knows_another() -> None:
    """What instruments of several makers share lies in `generic`, `transport`, `wire`, …"""
    for room in ("drivers", "sim_instruments"):
        makers = {path.parent.name for path in (ROOT / room).glob("*/*.py")} - NO_MAKERS
        for path in (ROOT / room).rglob("*.py"):
            others = [f"{room}.{maker}" for maker in makers - {path.parent.name}]
            broken = [name for name in imports(path) if within(name, *others)]
            assert not broken, f"{module_of(path)} may not import {broken}"


NO_MAKERS = {"generic", "transport", "wire", "world", "faults"}
ROLE_FILES = [path for path in SOURCES if within(module_of(path), "station.roles")]


@pytest.mark.parametrize("path", ROLE_FILES, ids=module_of)
def test_a_role_knows_little_of_the_engine(path: Path) -> None:
    """Drivers import roles, and may know no more of the engine than this."""
    known = ("roles", "clock", "errors", "fields", "units", "registry")
    for name in imports(path, typing_too=False, deep=True):
        assert not within(name, *ROOMS) or within(name, *(f"station.{one}" for one in known)), name
        assert not within(name, "numpy", "scipy"), f"{name} is loaded whenever a driver is"


def package_of(module: str) -> str:
    """Return the part of the engine that a module belongs to, or its room, or its procedure."""
    parts = module.split(".")
    return ".".join(parts[: 2 if parts[0] in ("station", "procedures") else 1])


def graph() -> dict[str, set[str]]:
    """Return which modules of ours each module imports: at its top, later, or for types alone."""
    found: dict[str, set[str]] = {}
    for path in SOURCES:
        names = set(imports(path, deep=True)) & MODULES
        found[module_of(path)] = names - {module_of(path)}
    return found


def test_no_module_imports_itself_over_others() -> None:
    """Imports within functions, and those for types alone, count."""
    list(TopologicalSorter(graph()).static_order())  # raises CycleError


def test_no_package_imports_itself_over_others() -> None:
    """Imports within functions, and those for types alone, count."""
    packages: dict[str, set[str]] = {}
    for module, names in graph().items():
        own = package_of(module)
        packages.setdefault(own, set()).update({package_of(one) for one in names} - {own})
    list(TopologicalSorter(packages).static_order())


ANALYSIS_FILES = [
    path
    for path in SOURCES
    if within(module_of(path), "procedures.estimation", WORDS) or path.stem == "analysis"
]


@pytest.mark.parametrize("path", ANALYSIS_FILES, ids=module_of)
def test_analysis_knows_no_instrument_no_file_and_no_clock(path: Path) -> None:
    for name in imports(path):
        assert name.split(".")[0] in ANALYSIS or within(name, "procedures", WORDS), name


def test_only_the_clock_asks_the_operating_system_for_the_time() -> None:
    for path in SOURCES:
        if within(module_of(path), "station.clock"):
            continue
        text = path.read_text(encoding="utf-8")
        if any(call + "(" in text for call in CLOCK):  # in a comment, perhaps
            text = ast.unparse(parsed(path))
        assert not [call for call in CLOCK if call + "(" in text], path


WORD = re.compile(r"[a-z]+")
TELL_NOTHING = {"one", "found", "stand", "course"}
"""A name states what the thing is: an instrument, an event, a match, a trajectory."""


def test_every_name_states_what_the_thing_is() -> None:
    for path in SOURCES:
        if TELL_NOTHING & set(WORD.findall(path.read_text(encoding="utf-8"))):  # or in a sentence
            names = {name for node in ast.walk(parsed(path)) for name in _names_of(node)}
            assert not TELL_NOTHING & names, path


def _names_of(node: ast.AST) -> Iterator[str]:
    """Yield the names that a node gives or uses, whatever kind of node it is."""
    for field in ("id", "arg", "attr", "name", "asname", "rest"):
        if isinstance(name := getattr(node, field, None), str):
            yield name


COMMAND_LINE = "import station.cli.app"
PROCEDURES = "from station.procedure import Procedures; dict(Procedures())"


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        (COMMAND_LINE, "numpy scipy pydantic yaml matplotlib GTC pyvisa can rich"),
        (PROCEDURES, "numpy scipy matplotlib GTC pyvisa can"),
    ],
    ids=["the command line", "the procedures, as validate needs them"],
)
def test_heavy_packages_stay_out_until_they_are_used(code: str, heavy: str) -> None:
    import subprocess
    import sys

    done = subprocess.run(
        [sys.executable, "-c", f"import sys; {code}; print(' '.join(sys.modules))"],
        capture_output=True,
        text=True,
        check=True,
        encoding="utf-8",
    )
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert not loaded & set(heavy.split())


EVERY_BENCHMARK = """
import contextlib, importlib, io, sys
for name in {names}:
    module = importlib.import_module(name)
    if hasattr(module, "argparse") and hasattr(module, "main"):
        sys.argv = [name, "--help"]
        with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
            module.main()
            raise AssertionError(name + " takes no --help")
"""


def test_every_benchmark_fits_the_engine() -> None:
    folder = ROOT / "benchmarks"
    names = sorted(path.stem for path in folder.glob("*.py"))
    assert names
    code = EVERY_BENCHMARK.format(names=names)
    paths = os.pathsep.join(map(str, (folder, ROOT / "tests" / "support", ROOT)))
    environment = {**os.environ, "PYTHONPATH": paths}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment, cwd=ROOT)


def test_a_benchmark_finds_the_helpers_of_the_tests_by_itself() -> None:
    helpers = {path.stem for path in (ROOT / "tests" / "support").glob("*.py")}
    for path in (ROOT / "benchmarks").glob("*.py"):
        text = path.read_text(encoding="utf-8")
        used = set(imports(path))  # `cases` finds them for whoever imports it
        if 'if __name__ == "__main__"' in text and used & helpers and "cases" not in used:
            assert "sys.path.insert(0, " in text, f"{path.name} needs PYTHONPATH"


@pytest.mark.parametrize("settings", sorted(ROOT.glob("procedures/*/settings.py")), ids=str)
def test_a_plan_takes_its_thresholds_from_the_analysis(settings: Path) -> None:
    """A number that a plan may state and an analysis uses is declared once."""
    declared = set(_defaults(settings)) | set(_defaults(ROOT / "station" / "findings.py"))
    plan = _defaults(settings.with_name("parameters.py"))
    shared = declared & set(plan)
    assert shared
    assert not [name for name in shared if isinstance(plan[name], ast.Constant)]


def test_a_frozen_instrument_is_worded_once() -> None:
    raised = [path for path in SOURCES if 'Flag("frozen"' in path.read_text(encoding="utf-8")]
    assert raised == [ROOT / "procedures" / "common" / "frozen.py"]


def _defaults(path: Path) -> dict[str, ast.expr]:
    """Return the attributes of a file's classes that have a number, or another default."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    lines = [line for node in classes for line in node.body if isinstance(line, ast.AnnAssign)]
    return {
        ast.unparse(line.target): line.value
        for line in lines
        if line.value is not None and not _is_none(line.value)
    }


def _is_none(value: ast.expr | None) -> bool:
    return isinstance(value, ast.Constant) and value.value is None
