"""A disk that is full: the bench is made safe first, then the run keeps what it has."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from campaign_helpers import (
    finished_units,
    only_run,
    opens,
    raw_content,
    short_plan,
    station,
    whole_events,
)
from campaigns.kills import written_bytes
from command_line import station_command
from limited_files import limited
from small_disk import read_only

from station.cli.analysing import analyse_run, export_run
from station.cli.reporting import remake_report
from station.clock import utc_now
from station.errors import RecordError
from station.record.folder import RunFolder
from station.record.signatures import new_key, sign
from station.record.verification import verify

if sys.platform == "win32":
    pytest.skip("there is no file-size limit to set", allow_module_level=True)

MAGIC_BYTES = 8


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_plan(tmp_path_factory.mktemp("plan"), axes=["IA", "NA"])


def safe_states(folder: Path) -> list[bool]:
    return [
        outcome["verified"]
        for event in whole_events(folder)
        if event["event"] == "safe-state"
        for outcome in event["outcomes"]
    ]


@pytest.fixture(scope="module")
def full_while_measuring(
    plan: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[subprocess.CompletedProcess[str], Path]:
    parent = tmp_path_factory.mktemp("full")
    # The first axis is measured by then: a raw file of the whole run holds about 180 kB.
    done = limited(110_000, plan, parent)
    folder = only_run(parent)
    assert folder is not None
    return done, folder


def test_a_full_disk_ends_the_run_with_a_safe_bench_and_exit_code_3(
    full_while_measuring: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    done, folder = full_while_measuring
    assert done.returncode == 3
    assert "cannot write" in done.stderr
    assert "File too large" in done.stderr
    assert "the bench is safe" in done.stderr
    assert "Traceback" not in done.stderr
    assert safe_states(folder) == [True, True]
    assert json.loads(done.stdout)["exit_code"] == 3


@pytest.mark.campaign
def test_a_full_disk_keeps_what_the_run_has(
    full_while_measuring: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    _, folder = full_while_measuring
    assert finished_units(folder) == ["warm-up", "IA"]
    for file in (folder / "raw").iterdir():
        content = raw_content(file)
        assert "IA" in content.rows
    assert [event.kind for event in RunFolder(folder).events][-1] == "run-ended"
    assert (folder / "manifest.json").is_file()
    assert not list(opens(folder))


def test_a_block_that_did_not_fit_is_taken_back_whole(
    full_while_measuring: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    _, folder = full_while_measuring
    for file in (folder / "raw").iterdir():
        assert ends_with_a_whole_record(file.read_bytes())


def ends_with_a_whole_record(data: bytes) -> bool:
    """Return whether an MCAP file holds whole records only, its end included or not."""
    offset = MAGIC_BYTES
    while offset + MAGIC_BYTES < len(data):
        offset += 9 + int.from_bytes(data[offset + 1 : offset + 9], "little")
    return offset == len(data) or offset + MAGIC_BYTES == len(data)


def test_a_disk_that_is_full_from_the_start_energises_nothing(plan: Path, tmp_path: Path) -> None:
    done = limited(2_000, plan, tmp_path / "runs")
    assert done.returncode == 3
    assert "cannot write" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list((tmp_path / "runs").iterdir())


@pytest.mark.campaign
def test_a_report_that_does_not_fit_leaves_complete_data(plan: Path, tmp_path: Path) -> None:
    done = limited(300_000, plan, tmp_path)
    assert done.returncode == 3
    folder = only_run(tmp_path)
    assert folder is not None
    assert "the data are complete" in done.stderr
    assert finished_units(folder) == ["warm-up", "IA", "NA"]
    assert safe_states(folder) == [True, True]
    assert not list(folder.rglob("*.part"))
    again = station("analyse", folder)
    assert again.returncode in (0, 1, 6), again.stderr


FULL_LOG = """
import resource, sys
from pathlib import Path
from station.clock import RealClock
from station.errors import RecordError
from station.record.folder import RunRecord
record = RunRecord(Path(sys.argv[1]), "procedure", "SN-1", RealClock())
soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
written = 0
try:
    while True:
        record.event("sample", number=written)
        written += 1
except RecordError:
    pass
record.note("safe-state", outcomes=[])
resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
record.note("run-ended", complete=False)
record.close()
print(written, len(record.faults))
"""


def test_an_event_that_does_not_fit_is_said_and_breaks_no_later_one(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-B", "-c", FULL_LOG, str(tmp_path)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    written, faults = map(int, done.stdout.split())
    folder = only_run(tmp_path)
    assert folder is not None
    kinds = [event["event"] for event in whole_events(folder)]
    assert kinds == ["sample"] * written + ["run-ended"]
    assert faults == 1
    assert "not recorded" in done.stderr


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a disk of 20 MB, where this user may; a smaller one is told before a run begins."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=20m", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.campaign
def test_a_disk_that_somebody_else_fills_is_the_same(plan: Path, small_disk: Path) -> None:
    command = station_command("run", plan, "--non-interactive", "--output", small_disk / "runs")
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, encoding="utf-8"
    )
    while not written_bytes(small_disk / "runs") and process.poll() is None:
        pass
    with pytest.raises(OSError, match="No space left"), (small_disk / "other").open("wb") as other:
        while True:
            other.write(bytes(1 << 16))
    _, said = process.communicate()
    assert process.returncode == 3, said
    assert "No space left on device" in said
    assert "the bench is safe" in said
    assert "Traceback" not in said
    folder = only_run(small_disk / "runs")
    assert folder is not None
    assert RunFolder(folder).run_facts()["clock"] == "VirtualClock"


def test_a_run_folder_that_takes_no_writes_is_said_to_be_so(
    one_axis_run: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(one_axis_run, tmp_path / one_axis_run.name))
    new_key(tmp_path / "lab.pem")

    def signs() -> None:
        sign(copy, tmp_path / "lab.pem", "A", utc_now())

    with read_only(copy):
        for write in (
            lambda: remake_report(copy, "html", "report"),
            lambda: export_run(copy, "csv"),
            lambda: export_run(copy, "hdf5"),
            signs,
        ):
            with pytest.raises(
                RecordError, match="Read-only file system; make its folder writable, or take a copy"
            ):
                write()
        with pytest.raises(RecordError, match=r"Read-only file system; .* with --output"):
            analyse_run(copy, None, compare=False)
        assert not verify(copy).changed
