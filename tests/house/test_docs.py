"""The documentation builds without a warning, and every example in it is carried out."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from docs_examples import ROOT, Workshop, examples

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(page for page in DOCS.rglob("*.md") if examples(page))]


@pytest.mark.campaign
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_work_as_it_says(page: Path, tmp_path: Path) -> None:
    Workshop(tmp_path).carry_out(page)


def test_a_driver_with_its_simulator_is_two_files_of_at_most_100_lines() -> None:
    files = {
        example.detail: len(example.text.splitlines())
        for example in examples(DOCS / "how-to" / "write-a-driver.md")
        if example.mark == "file" and "mag3" in example.detail
    }
    assert len(files) == 2
    assert sum(files.values()) <= 100, files


def test_a_procedure_is_three_files_of_at_most_130_lines() -> None:
    marked = examples(DOCS / "how-to" / "write-a-procedure.md")
    runs = next(place for place, example in enumerate(marked) if example.mark == "run")
    files = {
        example.detail: len(example.text.splitlines())
        for example in marked[:runs]
        if example.mark == "file" and "coil_constant/" in example.detail
    }
    assert len(files) == 3
    assert sum(files.values()) <= 130, files


@pytest.mark.campaign
def test_the_documentation_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    pytest.importorskip("myst_parser")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(DOCS), str(tmp_path)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "reference" / "bad-input.html").is_file()
    fetched = re.compile(r"<(?:script|img|link|iframe)[^>]*(?:src|href)=\"(?:https?:)?//")
    for site in tmp_path.rglob("*.html"):
        assert not fetched.search(site.read_text(encoding="utf-8")), site.name


def test_no_page_loads_anything_from_elsewhere(tmp_path: Path) -> None:
    for page in DOCS.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        assert "http://" not in text.replace("http://127.0.0.1", ""), page
        assert "https://" not in text, page
