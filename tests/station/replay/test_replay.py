"""A run recorded and served back to the drivers: nothing differs, and one byte is found."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from campaign_helpers import short_plan
from short_forms import SHORT_FORMS
from tiers import quick

from station import registry
from station.cli.replaying import replay_run
from station.clock import Clock
from station.errors import Aborted, InputError
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import Plan, read_plan
from station.instruments.bench import read_bench
from station.instruments.trace import LINE_SUMS, readable, sums_of
from station.procedure import Procedures
from station.record.layout import MANIFEST
from station.replay.deviations import MAX_SHOWN, Deviations
from station.replay.lines import changed_lines, restored
from station.replay.regression_test import write_test
from station.replay.replaying import replay
from station.replay.transcript import read_transcript, unreadable
from station.runner import execute as executing
from station.runner.execute import Request, execute

RAMP = "> LIST:CURR 0.0000"


def recorded(folder: Path, plan: Plan) -> Path:
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    return execute(Request(plan, bench, folder, quiet=True, report=False, trace=True)).folder


@pytest.fixture(scope="module")
def rlg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """SCPI and CAN."""
    folder = tmp_path_factory.mktemp("rlg")
    return recorded(folder, read_plan(short_plan(folder, axes=["IA"]), Procedures()))


@pytest.fixture(scope="module")
def serf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """SCPI with blocks of numbers, and lines of text."""
    name = "serf-nonorthogonality"
    plan = read_plan(find(PLANS, name), Procedures(), SHORT_FORMS[name])
    return recorded(tmp_path_factory.mktemp("serf"), plan)


def copy_of(run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(run, tmp_path / "run"))


def changed(run: Path, instrument: str, old: str, new: str) -> None:
    path = run / "trace" / f"{instrument}.txt"
    text = path.read_text(encoding="utf-8")
    assert old in text and len(old) == len(new)
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def line_of(run: Path, instrument: str, text: str) -> int:
    lines = (run / "trace" / f"{instrument}.txt").read_text(encoding="utf-8").splitlines()
    return next(number for number, line in enumerate(lines, 1) if text in line)


@pytest.mark.parametrize("which", quick(["rlg", "serf"], "rlg"))
def test_a_recorded_run_replays_without_a_deviation(
    which: str, request: pytest.FixtureRequest
) -> None:
    run: Path = request.getfixturevalue(which)
    said: list[str] = []
    deviations = replay(run, said.append)
    assert (deviations.lines()[:-1], said) == ([], [])
    sent = sum(
        one.direction == ">"
        for path in (run / "trace").glob("*.txt")
        for opening in read_transcript(path).openings
        for one in opening.entries
    )
    assert deviations.exchanges == sent > 100


def test_one_byte_of_a_command_is_found_with_instrument_time_and_line(
    rlg: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copy_of(rlg, tmp_path)
    changed(run, "coil_supply.x", RAMP, RAMP[:-1] + "1")
    (run / MANIFEST).unlink()  # which would have known
    assert replay_run(run, None, as_json=True) == 1
    document = json.loads(capsys.readouterr().out)
    (found,) = document["deviations"]
    lines = (run / "trace" / "coil_supply.x.txt").read_text(encoding="utf-8").splitlines()
    at = lines[found["line"] - 1]
    assert f"{found['time_s']:13.6f}" == at[:13]
    assert found["instrument"] == "coil_supply.x"
    assert RAMP[2:-1] + "1" in found["expected"] and RAMP[2:] in found["sent"]


def test_one_byte_of_an_answer_is_found_by_the_manifest(rlg: Path, tmp_path: Path) -> None:
    run = copy_of(rlg, tmp_path)
    changed(run, "gaussmeter", "LSA2B7X", "LSA2B7Y")
    deviations = replay(run)
    whole, line = deviations.altered
    assert whole == "gaussmeter: trace/gaussmeter.txt was changed since it was recorded"
    number = line_of(run, "gaussmeter", "LSA2B7Y")
    assert f"(line {number}), byte " in line and line.startswith("gaussmeter at ")
    recorded, _, now = line.partition(": recorded ")[2].partition(", is ")
    identity = r"'Lake Shore,F71,LSA2B7{},1.6.2019092002\r\n'"
    assert (recorded, now) == (identity.format("X"), identity.format("Y"))
    assert deviations.differences, "another serial number answers, and the run goes no further"
    lines = deviations.lines()
    assert len(lines) <= MAX_SHOWN + len(deviations.altered) + 2
    assert lines[-1].endswith(f"{len(deviations.differences)} deviations")


def test_a_run_that_was_killed_replays_to_where_its_transcript_ends(
    rlg: Path, tmp_path: Path
) -> None:
    run = copy_of(rlg, tmp_path)
    (run / MANIFEST).unlink()
    for path in (run / "trace").glob("*.txt"):
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        kept = [one for one in lines if one[0] == "#" or float(one[:13]) < 40.0]
        path.write_text("".join(kept) + "    40.0000", encoding="utf-8")
    deviations = replay(run)
    assert deviations.lines()[:-1] == []
    assert deviations.ended_s == pytest.approx(40.0, abs=5.0)


def test_a_run_that_was_aborted_replays_without_a_deviation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ends(record: object, clock: Clock) -> None:
        clock.repeat("a person", 33.3, lambda: clock.interrupt(Aborted("a person ended it")))

    plan = read_plan(short_plan(tmp_path, axes=["IA"]), Procedures())
    with monkeypatch.context() as patched:
        patched.setattr(executing, "watch_system_clock", ends)
        run = recorded(tmp_path, plan)
    assert '"exit_code": 4' in (run / "events.jsonl").read_text(encoding="utf-8")
    assert replay(run).lines()[:-1] == []


@pytest.mark.campaign
def test_one_command_makes_a_regression_test_of_a_transcript(
    rlg: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "test_bench.py"
    data = file.with_suffix(".zip")
    assert replay_run(rlg, file, as_json=False) == 0
    assert "no deviation" in capsys.readouterr().out
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(file)]
    passed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert passed.returncode == 0, passed.stdout
    assert len(file.read_text(encoding="utf-8").splitlines()) == 10
    with ZipFile(data) as kept:
        for path in (rlg / "trace").iterdir():
            assert kept.read(f"trace/{path.name}") == path.read_bytes()
    planted(data, "coil_supply.x", RAMP, RAMP[:-1] + "1")
    failed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert failed.returncode == 1 and "coil_supply.x at " in failed.stdout
    assert "LIST:CURR 0.0001" in failed.stdout and ", sent '" in failed.stdout
    planted(data, "coil_supply.x", RAMP[:-1] + "1", RAMP)
    planted(data, "gaussmeter", "LSA2B7X", "LSA2B7Y")
    failed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert failed.returncode == 1 and "gaussmeter at " in failed.stdout
    assert ", byte " in failed.stdout and "LSA2B7X" in failed.stdout
    with pytest.raises(InputError, match="cannot be written"):
        write_test(rlg, file)


def planted(data: Path, instrument: str, old: str, new: str) -> None:
    with ZipFile(data) as kept:
        files = {name: kept.read(name) for name in kept.namelist()}
    name = f"trace/{instrument}.txt"
    assert old.encode() in files[name]
    files[name] = files[name].replace(old.encode(), new.encode(), 1)
    with ZipFile(data, "w") as changed:
        for each, content in files.items():
            changed.writestr(each, content)


@pytest.mark.parametrize("length", [1, 40, 70_000, 140_000])
def test_one_changed_byte_of_a_line_is_restored_wherever_it_stands(length: int) -> None:
    rng = random.Random(length)
    for place in {0, length // 2, length - 1}:
        line = rng.randbytes(length).replace(b"\r", b"-")
        other = line[:place] + bytes([line[place] ^ 0x15]) + line[place + 1 :]
        assert restored(other, sums_of(line)) == line
    assert restored(line[::-1] + b"+", sums_of(line)) is None


def test_several_changed_bytes_of_a_line_are_named_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "gaussmeter.txt"
    recorded = "     0.000000 < 1.25\n     1.000000 < 1.50\n"
    path.write_text(recorded.replace("1.50", "2.51"), encoding="utf-8")
    sums = "\n".join(sums_of(line.encode()) for line in recorded.splitlines())
    path.with_suffix(LINE_SUMS).write_text(sums, encoding="ascii")
    assert changed_lines(path) == [
        "gaussmeter at 1.000000 s (line 2): more than one byte was changed since it was recorded"
    ]


def test_a_run_without_a_transcript_says_how_to_record_one(rlg: Path, tmp_path: Path) -> None:
    run = copy_of(rlg, tmp_path)
    shutil.rmtree(run / "trace")
    with pytest.raises(InputError, match="--record-wire"):
        replay(run)


def test_a_line_that_is_no_message_is_named(tmp_path: Path) -> None:
    path = tmp_path / "gaussmeter.txt"
    path.write_text("     0.000000 - opened\nhello\n     0.000000 > x\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"gaussmeter\.txt:2: "):
        read_transcript(path)


def test_every_byte_comes_back_from_its_text() -> None:
    every = bytes(range(256)) + b"\\x41\\n"
    assert unreadable(readable(every)) == every


def test_a_long_list_of_deviations_is_cut_with_its_count() -> None:
    deviations = Deviations()
    for number in range(MAX_SHOWN + 7):
        deviations.add("gaussmeter", float(number), b"READ?", b"FETC?", number)
    assert deviations.lines()[-2:] == [
        "and 7 more; --json lists all of them",
        f"0 messages sent, {MAX_SHOWN + 7} deviations",
    ]
