"""What stands where a file should be and is none: a pipe would be waited for without end."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from made_runs import made_run

from station.cli.validating import read_bench_named, read_plan_for
from station.dataset_reading import read_dataset
from station.errors import DamagedRecord
from station.files.faults import FaultList
from station.files.yaml.reading import read_text
from station.record.folder import RunFolder

WITHIN_S = 60.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of the laser gyro."""
    bench = read_bench_named("sim")
    plan = read_plan_for(
        "rlg-magnetic-sensitivity", bench, ("parameters.duration=100 s", "parameters.axes=[IA]")
    )
    return made_run(tmp_path_factory.mktemp("made"), plan, bench)


@pytest.fixture
def copy(run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(run, tmp_path / "run"))


def piped(file: Path) -> None:
    file.unlink(missing_ok=True)
    os.mkfifo(file)


def test_a_pipe_for_a_dataset_is_refused(tmp_path: Path) -> None:
    piped(tmp_path / "dataset.yaml")
    ended = subprocess.run(
        [sys.executable, "-m", "station", "analyse", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=WITHIN_S,
        check=False,
    )
    assert ended.returncode == 2
    assert "pipe or a device" in ended.stderr


def test_a_device_is_no_text() -> None:
    with pytest.raises(FaultList, match="pipe or a device"):
        read_text(Path("/dev/zero"), 10)


@pytest.mark.parametrize("way", ["pipe", "folder", "loop", "nowhere"])
def test_a_raw_file_that_is_none_counts_as_gone(way: str, copy: Path) -> None:
    file = copy / "raw" / "gaussmeter-000.mcap"
    file.unlink()
    if way == "pipe":
        os.mkfifo(file)
    elif way == "folder":
        file.mkdir()
    else:
        file.symlink_to(file if way == "loop" else copy / "nowhere")
    damage = RunFolder(copy).damage
    assert [part.what for part in damage.parts] == ["the file is gone"]
    assert damage.units


@pytest.mark.parametrize("name", ["bench.resolved.yaml", "plan.yaml", "run.json"])
def test_a_pipe_in_place_of_an_input_is_named(name: str, copy: Path) -> None:
    file = copy / name
    piped(file)
    said = RunFolder(copy).damage.altered
    assert any(name in one for one in said)


@pytest.mark.parametrize(
    ("way", "said"),
    [
        ("pipe", "is a pipe or a device, not a file"),
        ("device", "is a pipe or a device, not a file"),
        ("folder", "is a folder, not a file"),
        ("loop", "is a link that leads to itself"),
        ("nowhere", "is a link that leads nowhere"),
    ],
)
def test_what_stands_in_the_place_of_a_table_is_named(way: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "dataset.yaml").write_text(
        "dataset: 1\nprocedure: rlg-magnetic-sensitivity\n"
        "files: {samples: samples.csv}\nconditions: {}\n",
        encoding="utf-8",
    )
    (tmp_path / "sample.csv").write_text("time_s\n0\n", encoding="utf-8")
    file = tmp_path / "samples.csv"
    if way == "pipe":
        os.mkfifo(file)
    elif way == "folder":
        file.mkdir()
    else:
        file.symlink_to({"device": "/dev/zero", "loop": "samples.csv"}.get(way, "nowhere"))
    with pytest.raises(FaultList) as raised:
        read_dataset(tmp_path)
    assert f"'samples.csv' {said}" in str(raised.value)
    assert "did you mean" not in str(raised.value)


def test_a_pipe_for_the_facts_of_a_run_is_refused(copy: Path) -> None:
    piped(copy / "run.json")
    with pytest.raises(DamagedRecord, match=r"run\.json"):
        RunFolder(copy).run_facts()
