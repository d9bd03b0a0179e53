"""A package file stands where code is: a folder needs none to be a package."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from places import ROOT

MARKED = {"station", "drivers", "procedures", "sim_instruments", "config", "station/conformance"}
"""The packages that name their distribution, and the one that pytest collects by its name."""
FOUND = [
    path
    for top in ("station", "drivers", "procedures", "sim_instruments", "config")
    for path in sorted((ROOT / top).rglob("__init__.py"))
    if path.parent.relative_to(ROOT).as_posix() not in MARKED
]


@pytest.mark.parametrize("path", FOUND, ids=lambda path: str(path.parent.relative_to(ROOT)))
def test_a_package_file_holds_more_than_a_docstring(path: Path) -> None:
    body = ast.parse(path.read_text(encoding="utf-8")).body
    code = [one for one in body if not isinstance(one, ast.Expr | ast.ImportFrom | ast.Import)]
    assert code, f"{path}: delete it; say what the folder holds in docs/architecture.md"
