"""What `station new` writes works as it is written."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from bad_input_files import here
from docs_examples import make_known
from places import CONFIG

from station.cli.new import write_new
from station.cli.validating import read_bench_named, read_plan_for

SHIPPED = sorted(path.stem for path in (CONFIG / "plans").glob("*.yaml"))


@pytest.fixture(autouse=True)
def in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def uncommented(text: str) -> str:
    """Return a new plan whose values of the base are taken over, as the comment above them says."""
    head, last, values = text.partition("belongs to.\n")
    return (
        head + last + "".join(line.removeprefix("# ") for line in values.splitlines(keepends=True))
    )


@pytest.mark.parametrize("base", SHIPPED)
def test_a_new_plan_of_every_shipped_one_validates(base: str) -> None:
    write_new("plan", "mine", base)
    bench = read_bench_named("sim")
    plan = read_plan_for("mine", bench)
    assert plan.dut.serial == "FILL-IN"
    file = Path("config/plans/mine.yaml")
    file.write_text(uncommented(file.read_text(encoding="utf-8")), encoding="utf-8")
    assert read_plan_for("mine", bench).parameters == plan.parameters


def test_a_new_bench_validates_and_no_serial_number_is_invented() -> None:
    write_new("bench", "room-3")
    bench = read_bench_named("room-3")
    assert read_plan_for("rlg-magnetic-sensitivity", bench)
    stated = {name: entry.serial for name, entry in bench.instruments.items()}
    assert stated.pop("dut_power") is None
    assert set(stated.values()) == {"FILL-IN"}
    assert not any(entry.calibration for entry in bench.instruments.values())


def test_a_new_procedure_passes_its_own_tests(tmp_path: Path) -> None:
    write_new("procedure", "coil-constant-2")
    assert "2 passed" in pytest_with(tmp_path / "coil-constant-2", "coil-constant-2")


def test_a_new_driver_and_its_simulator_pass_the_conformance_run_that_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_new("driver", "mag-4")
    (command,) = re.findall(r"pytest (.+)", capsys.readouterr().err)
    printed = pytest_with(tmp_path / "mag-4", *command.split())
    assert re.search(r"^21 passed, 4 skipped, \d+ deselected", printed, re.MULTILINE), printed


def pytest_with(folder: Path, *arguments: str) -> str:
    """Return what pytest prints, beside a written package that is installed."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    make_known(project, folder)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments],
        env={
            "PYTHONPATH": str(folder),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "XDG_STATE_HOME": os.environ["XDG_STATE_HOME"],  # where no bench of the user tripped
        },
        capture_output=True,
        encoding="utf-8",
        check=False,
        timeout=300,
    )
    return done.stdout + done.stderr


@pytest.mark.parametrize("kind", ["plan", "bench", "procedure", "driver"])
def test_nothing_is_written_over(kind: str, tmp_path: Path) -> None:
    done = here(["new", kind, "mine"], tmp_path)
    assert done.returncode == 0
    assert all(Path(line.removeprefix("written: ")).is_file() for line in done.stdout.splitlines())
    assert "station " in done.stderr  # the next command
    written = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    again = here(["new", kind, "mine"], tmp_path)
    assert again.returncode == 2
    assert "already" in again.stderr
    assert written == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["bench", "sim"], "there is a bench 'sim' already"),
        (["plan", "commissioning"], "there is a plan 'commissioning' already"),
        (["procedure", "gyro-rate-table"], "there is a procedure 'gyro-rate-table' already"),
        (["procedure", "statistics"], "Python has a module 'statistics' already"),
        (["driver", "lakeshore-f71"], "there is a driver 'lakeshore-f71' already"),
        (["driver", "true"], "'true' is a keyword of Python"),
        (["procedure", "class"], "'class' is a keyword of Python; choose another name"),
        (["driver", "3d"], "'3d' is no name for this: write a small letter, then"),
        (["plan", "../mine"], "is no name"),
        (["bench", "mine", "--extends", "sim"], "--extends is for a plan"),
        (
            ["plan", "mine", "--extends", "gyro-rate-tabel"],
            "there is no plan 'gyro-rate-tabel'; did you",
        ),
    ],
)
def test_a_name_that_is_taken_or_is_none_is_refused(
    arguments: list[str], why: str, tmp_path: Path
) -> None:
    done = here(["new", *arguments], tmp_path)
    assert done.returncode == 2
    assert why in done.stderr
    assert not list(tmp_path.iterdir())
