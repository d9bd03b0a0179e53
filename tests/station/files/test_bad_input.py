"""Every kind of bad input: one clear sentence, the right exit code, nothing energised."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from bad_input_files import COLUMNS, here
from command_line import station
from places import ROOT

CASES = yaml.safe_load((Path(__file__).parent / "bad_input.yaml").read_text(encoding="utf-8"))
IN_PROCESS = ("validate", "analyse", "run")
"""Verbs that start no other process with these inputs."""


def attempt(case: dict[str, Any], folder: Path) -> subprocess.CompletedProcess[str]:
    """Lay out the files of a case, spoil them as it says, and run its command."""
    shutil.copy(ROOT / "config/plans/rlg-magnetic-sensitivity.yaml", folder / "plan.yaml")
    shutil.copy(ROOT / "config/benches/sim.yaml", folder / "bench.yaml")
    shutil.copytree(ROOT / "tests/data/rlg-one-axis", folder / "data")
    if "change" in case:
        file = folder / case["file"]
        old, new = case["change"]
        text = file.read_text(encoding="utf-8")
        assert old in text, f"{case['name']}: {old!r} is not in {case['file']}"
        file.write_text(text.replace(old, new, 1), encoding="utf-8")
    if "lines" in case:
        (folder / case["file"]).write_text("\n".join(case["lines"]), encoding="utf-8")
    if "remove" in case:
        (folder / case["remove"]).unlink()
    words = shlex.split(case["command"])
    if words[0] in IN_PROCESS:
        return here(words, folder)
    return station(folder, *words, COLUMNS=COLUMNS)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"].replace(" ", "-"))
def test_bad_input_is_told_in_one_sentence_before_anything_is_energised(
    case: dict[str, Any], tmp_path: Path
) -> None:
    done = attempt(case, tmp_path)
    assert done.returncode == case["exit"], done.stderr
    assert case["says"] in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == "" or case.get("energised")
    for log in tmp_path.rglob("events.jsonl"):
        began = "step-started" in log.read_text(encoding="utf-8")
        assert began == case.get("energised", False)
