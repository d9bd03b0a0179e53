"""Every kind of bad input: one clear sentence, the right exit code, nothing energised."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parent.parent
CASES = yaml.safe_load((Path(__file__).parent / "bad_input.yaml").read_text(encoding="utf-8"))


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
    return subprocess.run(
        [sys.executable, "-m", "station", *shlex.split(case["command"])],
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "COLUMNS": "200"},
        timeout=60,
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"].replace(" ", "-"))
def test_bad_input_is_told_in_one_sentence_before_anything_is_energised(
    case: dict[str, Any], tmp_path: Path
) -> None:
    done = attempt(case, tmp_path)
    assert done.returncode == case["exit"], done.stderr
    assert case["says"] in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    for log in tmp_path.rglob("events.jsonl"):
        assert "step-started" not in log.read_text(encoding="utf-8")
