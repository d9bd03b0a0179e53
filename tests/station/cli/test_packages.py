"""Packages of the same names as the station's own: beside the user, on the path, installed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from command_line import PLAN, station

from station.packages import DISTRIBUTION, MARK, NAMES, clashes, why_broken

FAILS = "raise RuntimeError('not the package of the station')\n"


def package(folder: Path, name: str, text: str = FAILS) -> Path:
    """Make a package of Python below a folder."""
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text(text, encoding="utf-8")
    return folder


def own_packages(root: Path) -> Path:
    """Make the station's own packages below a folder, as an installation has them."""
    for name in NAMES:
        package(root, name, f"{MARK}\n")
    return root


def test_folders_of_the_same_names_beside_the_user_break_nothing(tmp_path: Path) -> None:
    for name in NAMES:
        package(tmp_path, name)
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(tmp_path, "validate", "plan.yaml")
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    (tmp_path / "drivers" / "__init__.py").unlink()
    (tmp_path / "drivers.py").write_text(FAILS, encoding="utf-8")
    assert station(tmp_path, "validate", "plan.yaml").returncode == 0


def test_a_package_installed_under_the_same_name_is_named(tmp_path: Path) -> None:
    elsewhere = package(tmp_path / "elsewhere", "procedures")
    here = tmp_path / "here"
    here.mkdir()
    done = station(here, "list", "procedures", PYTHONPATH=str(elsewhere))
    assert done.returncode == 0, done.stderr
    assert "rlg-magnetic-sensitivity" in done.stdout
    assert f"WARNING: another package `procedures` is installed in {elsewhere}" in done.stderr


def test_a_package_that_was_imported_before_is_an_error_that_says_so(tmp_path: Path) -> None:
    package(tmp_path, "drivers", "")
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import drivers; "
        "from station.cli import main; sys.argv = ['station', 'list']; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 3
    assert "this program has imported another package `drivers`" in done.stderr


def test_a_package_that_was_replaced_is_an_error_that_says_so(tmp_path: Path) -> None:
    root = own_packages(tmp_path)
    (root / "drivers" / "__init__.py").write_text("", encoding="utf-8")
    said = why_broken(root)
    assert said is not None and "has installed a package `drivers` over it" in said
    (root / "drivers" / "__init__.py").unlink()
    assert why_broken(root) == said


@pytest.mark.parametrize("foreign", [(), ("drivers/motor.py",), ("drivers/a.py", "drivers/b.py")])
def test_files_of_another_package_among_the_own_ones_are_named(
    foreign: tuple[str, ...], tmp_path: Path
) -> None:
    root = own_packages(tmp_path)
    record = root / f"{DISTRIBUTION.replace('-', '_')}-1.0.dist-info" / "RECORD"
    record.parent.mkdir()
    listed = "".join(f"{name}/__init__.py,sha256=x,1\n" for name in NAMES)
    record.write_text(listed, encoding="utf-8")
    for name in foreign:
        (root / name).write_text("", encoding="utf-8")
    named = [said for said in clashes(root) if "has installed" in said]
    assert len(named) == (1 if foreign else 0)
    assert all(foreign[0] in said and "`drivers`" in said for said in named)
