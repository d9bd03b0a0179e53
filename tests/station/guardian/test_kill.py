"""A killed run leaves a folder that opens, every finished unit whole, and goes on from there.

The long form, 100 kills on virtual and 20 on scaled time, is `benchmarks/kill_campaign.py`.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_helpers import (
    finished_units,
    raw_content,
    short_plan,
    station,
)
from campaigns.kills import (
    Case,
    judge,
    results_of,
    wrong_results,
)

from station.record.folder import RunFolder
from station.record.raw import RawIndex

VIRTUAL = range(3)
SCALED = (11,)
"""Half of the data are written: the first axis is finished or near its end."""
SPEED = 50.0


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_plan(tmp_path_factory.mktemp("plan"), axes=["IA", "NA"])


@pytest.fixture(scope="module")
def reference(plan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same run, undisturbed."""
    parent = tmp_path_factory.mktemp("reference")
    done = station("run", plan, "--non-interactive", "--output", parent)
    assert done.returncode == 0, done.stderr
    return next(parent.iterdir())


@pytest.mark.campaign
@pytest.mark.parametrize("seed", VIRTUAL)
def test_a_kill_on_virtual_time_leaves_a_beginning_of_the_run_that_goes_on(
    seed: int, plan: Path, reference: Path, tmp_path: Path
) -> None:
    line = judge(Case(seed, (str(plan),), reference), tmp_path / "killed")
    assert not line["faults"], line


@pytest.mark.campaign
@pytest.mark.parametrize("seed", SCALED)
def test_a_kill_on_scaled_time_leaves_a_safe_world_and_a_run_that_goes_on(
    seed: int, plan: Path, reference: Path, tmp_path: Path
) -> None:
    line = judge(Case(seed, (str(plan),), reference, speed=SPEED), tmp_path / "killed")
    assert line["has_folder"] and line["guardian"]
    assert not line["faults"], line


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("scaled", "changes", "said"),
    [
        (True, {"verdict": "inconclusive", "U": 20.0}, None),
        (False, {"verdict": "inconclusive", "U": 20.0}, "IA: the verdict is inconclusive with U"),
        (True, {"verdict": "inconclusive"}, "IA: the verdict is inconclusive with U"),
        (True, {"verdict": "fail", "U": 20.0}, "IA: the verdict is fail with U"),
        (True, {"off": 5.0}, "IA is 0."),
        (True, {"off": 20.0, "verdict": "inconclusive", "U": 3.0}, "u off the truth"),
    ],
)
def test_a_resumed_run_may_be_less_sure_where_time_is_faster_and_never_wrong(
    scaled: bool, changes: dict[str, Any], said: str | None, reference: Path, tmp_path: Path
) -> None:
    shutil.copy(reference / "bench.yaml", tmp_path)
    document = results_of(reference)
    one = document["results"][0]
    one["value"] += changes.get("off", 0.0) * one["standard_uncertainty"]
    for name in ("standard_uncertainty", "expanded_uncertainty"):
        one[name] *= changes.get("U", 1.0)
    one["verdict"] = document["verdict"] = changes.get("verdict", "pass")
    (tmp_path / "results.json").write_text(json.dumps(document), encoding="utf-8")
    wrong = list(wrong_results(tmp_path, reference, scaled=scaled))
    assert any(said in one for one in wrong) if said else not wrong, wrong


@pytest.mark.campaign
def test_what_a_kill_left_says_how_far_the_run_came(reference: Path, tmp_path: Path) -> None:
    cut_after(reference, tmp_path / "cut", "unit-started", "NA")
    done = station("analyse", tmp_path / "cut", "--output", tmp_path / "out")
    assert done.returncode in (0, 1, 6), done.stderr
    assert "NA was not measured to its end" in done.stdout
    assert finished_units(tmp_path / "cut") == ["warm-up", "IA"]


def test_a_log_cut_anywhere_is_read_to_its_last_whole_line(reference: Path, tmp_path: Path) -> None:
    whole = (reference / "events.jsonl").read_bytes()
    for length in np.random.default_rng(0).integers(0, len(whole), 200):
        (tmp_path / "events.jsonl").write_bytes(whole[:length])
        assert len(RunFolder(tmp_path).events) == whole[:length].count(b"\n")


def test_a_raw_file_cut_anywhere_is_read_to_its_last_whole_block(
    reference: Path, tmp_path: Path
) -> None:
    file = reference / "raw" / "gaussmeter-000.mcap"
    whole, cut = file.read_bytes(), tmp_path / "cut.mcap"
    blocks = raw_content(file).rows["IA"]
    for length in np.random.default_rng(1).integers(0, len(whole) // 2, 60):
        cut.write_bytes(whole[:length])
        kept = list(RawIndex(cut).blocks("IA"))
        assert all((left == right).all() for left, right in zip(kept, blocks, strict=False))
        assert len(kept) == len(raw_content(cut).rows.get("IA", []))


def test_zeros_at_the_end_of_a_raw_file_hide_nothing(reference: Path, tmp_path: Path) -> None:
    # What a lost power supply leaves where a file's length was on disk before its data.
    file = reference / "raw" / "gaussmeter-000.mcap"
    whole = file.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2] + bytes(5000))
    (tmp_path / "plain.mcap").write_bytes(whole[: len(whole) // 2])
    kept = [
        len(list(RawIndex(tmp_path / name).blocks("IA"))) for name in ("cut.mcap", "plain.mcap")
    ]
    assert kept[0] == kept[1] > 0


def test_nothing_that_was_being_built_stays_behind(reference: Path) -> None:
    assert not list(reference.parent.glob(".*"))
    assert not list(reference.rglob("*.part"))


def cut_after(run: Path, to: Path, kind: str, unit: str) -> None:
    """Copy a run with its log as it was after an event."""
    shutil.copytree(
        run,
        to,
        ignore=shutil.ignore_patterns("revisions", "results.json", "report*", "manifest.json"),
    )
    lines = (run / "events.jsonl").read_bytes().splitlines(keepends=True)
    wanted = [f'"{kind}"'.encode(), f'"{unit}"'.encode()]
    last = next(n for n, line in enumerate(lines) if all(text in line for text in wanted))
    (to / "events.jsonl").write_bytes(b"".join(lines[: last + 1]))


if sys.platform == "win32":
    pytest.skip("kill means TerminateProcess there; not verified", allow_module_level=True)
