"""A run by a part of its name."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import station

from station.cli.looking import entries
from station.cli.options import active_run, complete_run
from station.control.status import newest_run
from station.errors import InputError
from station.files.locks import FileLock
from station.record import run_list
from station.record.events import EventLog
from station.record.layout import EVENTS, LOCK
from station.record.run_names import find_run, runs_below

NAMES = (
    "20260101T000000Z-rlg-magnetic-sensitivity-SN-0042",
    "20260102T000000Z-rlg-magnetic-sensitivity-SN-0043",
    "20260103T000000Z-rlg-magnetic-sensitivity-SN-0043",
)


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    for name in (*NAMES, ".hidden-SN-0042"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / EVENTS).touch()
    (tmp_path / "runs" / "no-run-SN-0042").mkdir()
    return tmp_path / "runs"


def test_a_part_that_one_name_holds_is_that_run(runs: Path) -> None:
    assert find_run(Path("sn-0042"), runs) == runs / NAMES[0]
    assert find_run(Path(NAMES[1]), runs) == runs / NAMES[1]
    assert find_run(Path("20260103"), runs) == runs / NAMES[2]


def test_a_path_is_taken_as_it_is(runs: Path) -> None:
    assert find_run(runs, runs) == runs
    with pytest.raises(InputError, match=r"the path elsewhere.SN-0042 does not exist"):
        find_run(Path("elsewhere/SN-0042"), runs)


def test_several_are_listed_newest_first_and_none_is_refused(runs: Path) -> None:
    with pytest.raises(InputError) as refused:
        find_run(Path("SN-0043"), runs)
    said = str(refused.value)
    assert said.index(NAMES[2]) < said.index(NAMES[1])
    with pytest.raises(InputError, match="no run below"):
        find_run(Path("SN-0044"), runs)


@pytest.mark.parametrize("serial", ["A b#1", "😀", "é"])
def test_a_serial_number_that_no_folder_is_named_by_means_its_run(runs: Path, serial: str) -> None:
    for number, each in enumerate((serial, "B c")):
        run = runs / f"2026010{number + 4}T000000Z-rlg-magnetic-sensitivity-_"
        run.mkdir()
        log = EventLog(run / EVENTS)
        log.append(0.0, "run-started", {"dut": {"serial": each}}, durable=False)
        log.close()
    assert find_run(Path(serial), runs).name.startswith("20260104")


def test_runs_are_listed_newest_first_and_one_without_a_stamp_by_when_it_began(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, utc in (("copy", "2026-01-02T13:00:00+01:00"), ("unknown", "")):
        (runs / name).mkdir()
        (runs / name / EVENTS).touch()
        (runs / name / "run.json").write_text(json.dumps({"started_utc": utc}), encoding="utf-8")
    monkeypatch.chdir(runs.parent)
    (runs / "zz").symlink_to(runs / NAMES[0])
    assert "zz" not in [run.name for run in runs_below(runs)]
    newest_first = [NAMES[2], "copy", NAMES[1], NAMES[0], "unknown"]
    assert [entry["name"] for entry in entries("runs")] == newest_first
    assert newest_run(runs).name == NAMES[2]


def test_runs_are_listed_by_pages_of_which_the_others_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(120):
        folder = tmp_path / "store" / f"20260101T{number:06d}Z-rlg-magnetic-sensitivity-SN"
        folder.mkdir(parents=True)
        (folder / EVENTS).touch()
    looks = list[Path]()
    whole = run_list.entry_of
    monkeypatch.setattr(run_list, "entry_of", lambda run: [looks.append(run), whole(run)][1])

    def page(number: int, search: str = "") -> list[str]:
        listed = entries("runs", search, str(tmp_path / "store"), number)
        return [entry["name"][9:15] for entry in listed]

    assert page(1) == [f"{number:06d}" for number in range(119, 68, -1)]
    assert page(2)[:1] == page(2, "rlg")[:1] == ["000069"]
    assert len(page(3)) == len(page(3, "RLG")) == 20
    assert page(4) == page(1, "nothing") == []
    looks.clear()
    page(2)
    assert len(looks) == 51
    with pytest.raises(InputError, match="there is no folder"):
        entries("runs", store=str(tmp_path / "nowhere"))


def test_the_command_line_takes_a_part_of_a_name(runs: Path) -> None:
    done = station(runs.parent, "status", "SN-0043")
    assert done.returncode == 2
    assert NAMES[2] in done.stderr


def test_of_several_the_active_run_is_meant(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(runs.parent)
    with held(runs / NAMES[2]):
        assert active_run(Path("SN-0043")) == Path("runs") / NAMES[2]
        with held(runs / NAMES[1]), pytest.raises(InputError, match="2 active runs") as refused:
            active_run(Path("SN-0043"))
        assert NAMES[1] in str(refused.value) and NAMES[2] in str(refused.value)
        assert active_run(Path(NAMES[1])) == Path("runs") / NAMES[1]
    with pytest.raises(InputError, match="2 runs below"):
        active_run(Path("SN-0043"))


@contextmanager
def held(run: Path) -> Iterator[None]:
    """A run that a process is at work on."""
    lock = FileLock(run / LOCK)
    try:
        yield
    finally:
        lock.release()


def test_a_shell_completes_it(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(runs.parent)
    assert complete_run("SN-004") == list(reversed(NAMES))
    assert complete_run("SN-0042") == [NAMES[0]]
