"""Damaged data: what is damaged is named and left out, and changes no result in silence."""

from __future__ import annotations

import hashlib
import json
import random
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bad_input_files import here
from tiers import quick

from station.errors import DamagedRecord
from station.record.blocks import CHUNK, END, HEAD, scan
from station.record.events import REVISED
from station.record.folder import RunFolder
from station.record.layout import write_manifest
from station.record.raw import chunk_of
from station.runner.evaluation import conclude_run, evaluate_run

PROCEDURES = (
    "rlg-magnetic-sensitivity",
    "accelerometer-magnetic-sensitivity",
    "serf-nonorthogonality",
    "fog-scale-factor-temperature",
    "nine-axis-calibration",
)
FLIPS = 2


@pytest.fixture
def copy(run_of: Callable[[str], Path], tmp_path: Path) -> Path:
    """A finished run of the laser gyro that may be spoiled."""
    return Path(shutil.copytree(run_of(PROCEDURES[0]), tmp_path / "run"))


def flipped(file: Path, byte: int, bit: int = 0) -> None:
    data = bytearray(file.read_bytes())
    data[byte] ^= 1 << bit
    file.write_bytes(data)


def results(folder: Path) -> tuple[dict[str, Any], RunFolder]:
    run = RunFolder(folder)
    return evaluate_run(run)[0].to_data(), run


def without_lengths(folder: Path) -> None:
    """Make the log one of before it said how long the raw files were; drop the manifest."""
    previous, lines = "0" * 64, []
    for line in (folder / "events.jsonl").read_bytes().splitlines():
        event = {**json.loads(line), "previous": previous}
        if event["event"] == REVISED:
            break
        event.pop("raw_bytes", None)
        lines.append(json.dumps(event, ensure_ascii=False).encode())
        previous = hashlib.sha256(lines[-1]).hexdigest()
    (folder / "events.jsonl").write_bytes(b"\n".join(lines) + b"\n")
    (folder / "manifest.json").unlink()


def blocks_in(file: Path) -> list[tuple[int, int, str]]:
    """The whole blocks of a raw file in their order: first byte, length, unit of work."""
    places = scan(file).places.items()
    return sorted(
        (at, length, unit) for unit, both in places for at, length in zip(*both, strict=True)
    )


def rewritten(file: Path, *parts: bytes) -> None:
    file.write_bytes(HEAD + b"".join(parts) + END)


def remade(block: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """A block whose records are changed and whose check sum is made anew."""
    records = change(block[CHUNK.size :])
    return chunk_of(records, int.from_bytes(block[9:17], "little"))


def station(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return here([str(word) for word in words], Path.cwd())


def codes(document: dict[str, Any]) -> list[str]:
    return [flag["code"] for flag in document["flags"]]


@pytest.mark.parametrize("sealed", [True, False], ids=["finished", "without-manifest"])
@pytest.mark.parametrize(
    "procedure", quick(PROCEDURES, *PROCEDURES[:2], "fog-scale-factor-temperature")
)
def test_one_flipped_bit_in_raw_data_is_named_and_takes_its_unit_out(
    procedure: str, sealed: bool, run_of: Callable[[str], Path], tmp_path: Path
) -> None:
    run, numbers = run_of(procedure), random.Random(f"{procedure} {sealed}")
    for number in range(FLIPS):
        folder = tmp_path / str(number)
        shutil.copytree(run, folder)
        if not sealed:
            (folder / "manifest.json").unlink()
        file = numbers.choice(sorted((folder / "raw").iterdir()))
        size = file.stat().st_size
        part = [(0, 25), (25, 90), (size - 37, size)][number] if number < 3 else (0, size)
        flipped(file, numbers.randrange(*part), numbers.randrange(8))
        document, seen = results(folder)
        named = [f for f in document["flags"] if f["code"] == "data-damaged"]
        assert named, (file.name, number)
        assert all(file.name in flag["message"] for flag in named)
        assert {unit for flag in named for unit in flag["units"]} == set(seen.left_out)
        assert document["verdict"] != "pass"
        assert len(seen.left_out) <= 1 or number == 1
        shutil.rmtree(folder)


def test_all_other_units_are_still_analysed_behind_a_damaged_block(copy: Path) -> None:
    before = {one["axis"]: one["value"] for one in results(copy)[0]["results"]}
    flipped(copy / "raw" / "gaussmeter-000.mcap", 5000)
    document, run = results(copy)
    after = {one["axis"]: one["value"] for one in document["results"]}
    assert run.left_out == {"IA"}
    assert after["IA"] is None
    assert after["NA"] == pytest.approx(before["NA"], rel=0.2)


def test_a_log_without_lengths_of_the_raw_files_still_takes_the_unit_out(copy: Path) -> None:
    # What runs of before wrote: the times of the blocks tell whose they are.
    without_lengths(copy)
    assert results(copy)[0]["results"]
    flipped(copy / "raw" / "gaussmeter-000.mcap", 40000)
    document, run = results(copy)
    assert len(run.left_out) == 1
    assert "data-damaged" in codes(document)


@pytest.mark.parametrize("sealed", [True, False], ids=["finished", "without-manifest"])
def test_a_raw_file_cut_short_takes_out_the_units_that_had_more(copy: Path, sealed: bool) -> None:
    if not sealed:
        (copy / "manifest.json").unlink()
    raw = copy / "raw" / "gyro_acquisition-000.mcap"
    raw.write_bytes(raw.read_bytes()[:-3000])
    document, run = results(copy)
    assert run.left_out == {"NA"}
    assert document["verdict"] == "inconclusive"


def test_a_lost_raw_file_is_named(copy: Path) -> None:
    (copy / "raw" / "gaussmeter-000.mcap").unlink()
    document, run = results(copy)
    assert run.left_out == {"IA", "NA"}
    assert all(one["value"] is None for one in document["results"])


def test_a_raw_file_of_another_run_is_refused(copy: Path, run_of: Callable[[str], Path]) -> None:
    raw = copy / "raw" / "gaussmeter-000.mcap"
    at, length, _ = blocks_in(raw)[1]
    data = raw.read_bytes()
    other = remade(data[at : at + length], lambda records: records[:-1] + b"\x01")
    raw.write_bytes(data[:at] + other + data[at + length :])  # its check sum is made anew, too
    with pytest.raises(DamagedRecord, match=r"gaussmeter-000\.mcap is not the file that the run"):
        results(copy)


@pytest.mark.parametrize("way", ["copied", "exchanged"])
@pytest.mark.parametrize("procedure", quick(PROCEDURES, *PROCEDURES[:2]))
def test_a_whole_block_in_the_place_of_another_is_named(
    procedure: str, way: str, run_of: Callable[[str], Path], tmp_path: Path
) -> None:
    run, numbers = run_of(procedure), random.Random(f"{procedure} {way}")
    finished = set(RunFolder(run).finished_units())
    tried = 0
    for file in sorted((run / "raw").iterdir()):
        data, blocks = file.read_bytes(), blocks_in(file)
        alike = [(a, b) for a in blocks for b in blocks if a[1] == b[1] and a != b]
        for first, second in numbers.sample(alike, min(1, len(alike))):
            folder = Path(shutil.copytree(run, tmp_path / str(tried)))
            (folder / "manifest.json").unlink()
            spoiled, length = bytearray(data), first[1]
            spoiled[second[0] : second[0] + length] = data[first[0] : first[0] + length]
            if way == "exchanged":
                spoiled[first[0] : first[0] + length] = data[second[0] : second[0] + length]
            (folder / "raw" / file.name).write_bytes(spoiled)
            document, seen = results(folder)
            lost = {second[2], first[2]} if way == "exchanged" else {second[2]}
            assert seen.left_out >= lost & finished, (file.name, first, second)
            assert "data-damaged" in codes(document)
            assert document["verdict"] != "pass"
            tried += 1
            shutil.rmtree(folder)
    assert tried


def test_a_copied_block_takes_out_the_unit_in_whose_place_it_stands(copy: Path) -> None:
    (copy / "manifest.json").unlink()
    raw = copy / "raw" / "gaussmeter-000.mcap"
    blocks = blocks_in(raw)
    of_IA = [(at, length) for at, length, unit in blocks if unit == "IA"][5:]
    of_NA = {length: at for at, length, unit in blocks if unit == "NA"}
    at, length = next(one for one in of_IA if one[1] in of_NA)
    data = bytearray(raw.read_bytes())
    data[at : at + length] = data[of_NA[length] : of_NA[length] + length]
    raw.write_bytes(data)
    assert results(copy)[1].left_out == {"IA"}


@pytest.mark.parametrize(("place", "units"), [(10, {"IA"}), (49, {"IA", "NA"}), (-1, {"NA"})])
def test_a_block_cut_out_neatly_names_the_units_around_it(
    place: int, units: set[str], copy: Path
) -> None:
    (copy / "manifest.json").unlink()
    raw = copy / "raw" / "gaussmeter-000.mcap"
    blocks = blocks_in(raw)
    assert [unit for _, _, unit in blocks].index("NA") == 50
    blocks.pop(place)
    data = raw.read_bytes()
    rewritten(raw, *(data[at : at + length] for at, length, _ in blocks))
    document, run = results(copy)
    assert run.left_out == units
    assert document["verdict"] == "inconclusive"


def test_a_time_that_falls_is_a_damaged_block(copy: Path) -> None:
    (copy / "manifest.json").unlink()
    raw = copy / "raw" / "gaussmeter-000.mcap"
    blocks, data = blocks_in(raw), raw.read_bytes()
    parts = [data[at : at + length] for at, length, _ in blocks]
    early = int.from_bytes(parts[5][9:17], "little").to_bytes(8, "little")
    was = parts[20][9:17]
    records = parts[20][CHUNK.size :].replace(was, early)
    parts[20] = chunk_of(records, int.from_bytes(early, "little"))
    rewritten(raw, *parts)
    assert results(copy)[1].left_out == {"IA"}


def test_raw_files_of_two_sources_exchanged_are_exit_code_2(copy: Path) -> None:
    (copy / "manifest.json").unlink()
    first, second = (copy / "raw" / f"{n}-000.mcap" for n in ("gaussmeter", "gyro_acquisition"))
    was = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(was)
    write_manifest(copy)
    done = station("analyse", copy)
    assert done.returncode == 2, done.stderr
    assert f"{first.name} was altered: it holds blocks of gyro_acquisition" in done.stderr
    assert f"{second.name} was altered" in done.stderr


@pytest.mark.parametrize("procedure", quick(PROCEDURES, *PROCEDURES[:2]))
def test_a_unit_without_rows_is_left_out_and_named(
    procedure: str, run_of: Callable[[str], Path], tmp_path: Path
) -> None:
    run = run_of(procedure)
    finished = list(RunFolder(run).finished_units())
    for n, file in enumerate(sorted((run / "raw").iterdir())):
        data, blocks = file.read_bytes(), blocks_in(file)
        units = [unit for unit in finished if unit in {unit for _, _, unit in blocks}]
        gone = units[len(units) // 2]
        folder = Path(shutil.copytree(run, tmp_path / f"{n}"))
        (folder / "manifest.json").unlink()
        kept = [data[at : at + length] for at, length, unit in blocks if unit != gone]
        rewritten(folder / "raw" / file.name, *kept)
        document, seen = results(folder)
        assert gone in seen.left_out, file.name
        assert "data-damaged" in codes(document)
        assert document["verdict"] == "inconclusive"
        shutil.rmtree(folder)
        folder = Path(shutil.copytree(run, tmp_path / f"{n}-empty"))
        without_lengths(folder)
        rewritten(folder / "raw" / file.name)  # nothing in it is damaged, but nothing is in it
        document, seen = results(folder)
        if not file.name.startswith("thermal_chamber"):  # only the report shows what it says
            assert document["verdict"] == "inconclusive"
            assert {one for flag in document["flags"] for one in flag.get("units", ())}
        shutil.rmtree(folder)


@pytest.mark.parametrize("verb", ["report", "export"])
def test_a_folder_that_is_no_run_is_exit_code_2(verb: str, tmp_path: Path) -> None:
    options = ["--format", "csv"] if verb == "export" else []
    done = station(verb, tmp_path, *options)
    assert done.returncode == 2, done.stderr
    assert "is no run folder" in done.stderr


def test_whole_blocks_of_other_columns_are_exit_code_2_with_a_sentence(copy: Path) -> None:
    without_lengths(copy)
    raw = copy / "raw" / "gaussmeter-000.mcap"
    data = raw.read_bytes()
    parts = [data[at : at + length] for at, length, _ in blocks_in(raw)]
    rewritten(raw, *(remade(one, lambda it: it.replace(b"'x_T'", b"'q_T'")) for one in parts))
    for verb in ("analyse", "report"):
        done = station(verb, copy)
        assert done.returncode == 2, done.stderr
        assert "finds no solution in the data of this run" in done.stderr


@pytest.mark.parametrize("sealed", [True, False], ids=["finished", "without-manifest"])
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("plan.resolved.yaml", "max_abs: 0.1 deg/h/mT", "max_abs: 0.2 deg/h/mT"),
        ("plan.resolved.yaml", "serial: SN-0042", "serial: SN-0043"),
        ("bench.resolved.yaml", "serial: LSA2B7X", "serial: LSA2B7Y"),
        ("bench.resolved.yaml", "relative: ", "relative: 1"),
    ],
)
def test_a_changed_plan_or_bench_is_exit_code_2_by_name(
    name: str, old: str, new: str, sealed: bool, copy: Path
) -> None:
    if not sealed:
        (copy / "manifest.json").unlink()
    text = (copy / name).read_text(encoding="utf-8")
    assert old in text
    (copy / name).write_text(text.replace(old, new, 1), encoding="utf-8")
    before = sorted(copy.rglob("*"))
    for verb in ("analyse", "report", "export"):
        options = ["--format", "csv"] if verb == "export" else []
        done = station(verb, copy, *options)
        assert done.returncode == 2, done.stderr
        assert f"{name} was changed since the run began" in done.stderr
    assert sorted(copy.rglob("*")) == before


def test_a_changed_input_file_is_exit_code_2(run_of: Callable[[str], Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(run_of("fog-scale-factor-temperature"), tmp_path / "run"))
    (file,) = (folder / "inputs").iterdir()
    flipped(file, 100)
    with pytest.raises(DamagedRecord, match=f"{file.name} was changed since the run began"):
        results(folder)


def test_a_changed_line_of_the_log_is_exit_code_2_with_its_number(copy: Path) -> None:
    log = copy / "events.jsonl"
    lines = log.read_bytes().splitlines(keepends=True)
    changed = [*lines[:3], lines[3].replace(b'"t_s": ', b'"t_s": 1'), *lines[4:]]
    log.write_bytes(b"".join(changed))
    done = station("analyse", copy)
    assert done.returncode == 2
    assert "events.jsonl:5: the log was altered: line 4 is not" in done.stderr
    log.write_bytes(b"".join(lines[:-1]))  # the chain holds, but the manifest knows better
    done = station("analyse", copy)
    assert done.returncode == 2
    assert f"events.jsonl:{len(lines) - 1}: the log was altered" in done.stderr


def test_a_killed_run_says_that_it_has_no_manifest(copy: Path) -> None:
    assert "no-manifest" not in codes(results(copy)[0])
    (copy / "manifest.json").unlink()
    document, run = results(copy)
    assert "no-manifest" in codes(document)
    assert not run.left_out


def test_altered_results_are_named_and_not_compared_with(copy: Path) -> None:
    flipped(copy / "results.json", 200)
    done = station("analyse", copy)
    assert done.returncode in (0, 6), done.stderr
    assert "altered: " in done.stderr
    assert "results.json was changed" in done.stderr
    done = station("analyse", copy, "--compare")
    assert done.returncode == 2
    assert "results.json was changed" in done.stderr


@pytest.mark.parametrize("procedure", quick(PROCEDURES, *PROCEDURES[:2]))
def test_any_unit_of_work_may_be_left_out(
    procedure: str, run_of: Callable[[str], Path], tmp_path: Path
) -> None:
    whole = RunFolder(run_of(procedure))
    units = [*whole.finished_units()]
    chosen = units if len(units) <= 6 else random.Random(procedure).sample(units, 6)
    for out in [*([one] for one in chosen), units, units[1:], units[::2]]:
        run = RunFolder(whole.path)
        run.leave_out(out)
        document, _ = evaluate_run(run)
        assert json.dumps(document.to_data(), allow_nan=False)


def test_the_number_000_belongs_to_the_run_itself(copy: Path) -> None:
    shutil.rmtree(copy / "revisions")
    assert station("analyse", copy).returncode == 0
    assert [path.name for path in (copy / "revisions").iterdir()] == ["001"]
    conclude_run(copy, report=False)
    assert (copy / "revisions" / "000" / "results.json").is_file()
