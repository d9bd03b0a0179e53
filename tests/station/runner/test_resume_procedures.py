"""Every procedure goes on after a kill: what was finished stays, and the numbers agree."""

from __future__ import annotations

import math
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from campaign_helpers import only_run, shipped
from command_line import station_command

from station.record.folder import RunFolder
from station.record.layout import EVENTS, file_hash
from station.runner.resuming import ResumeRequest, resume

SHORT: dict[str, dict[str, Any]] = {
    "accelerometer-magnetic-sensitivity": {
        "design": "efficient",
        "largest_field": "45 mT",
        "field_step": None,
        "angle_step": None,
        "order": "as_published",
        "repeats": 1,
        "readings": 2,
        "warm_up": "10 s",
    },
    "accelerometer-tumble": {"positions": 8, "dwell": "2 s", "readings": 2, "warm_up": "1 min"},
    "serf-nonorthogonality": {},
    "serf-nonorthogonality by modulation": {"nulling": "modulation"},
    "gyro-static-noise-navigator": {"record": "20 min", "repeats": 1, "repeat_record": "5 min"},
    "gyro-rate-table-imu": {
        "rates": ["20 deg/s", "50 deg/s", "100 deg/s"],
        "record": "20 s",
        "stand": "20 s",
        "switch_ons": 2,
    },
}
KILLED_AFTER = {
    "accelerometer-magnetic-sensitivity": 20,
    "accelerometer-tumble": 25,
    "serf-nonorthogonality": 6,
    "serf-nonorthogonality by modulation": 6,
    "gyro-static-noise-navigator": 3,
    "gyro-rate-table-imu": 3,
}
AGREES = 5.0
GIVES_UP_AFTER_S = 120.0


def finished(parent: Path) -> int:
    """Return how many units of work the run below a folder has finished by now."""
    logs = list(parent.glob("[!.]*/" + EVENTS))
    return logs[0].read_text(encoding="utf-8").count('"unit-finished"') if logs else 0


@pytest.mark.campaign
@pytest.mark.parametrize("procedure", SHORT)
def test_a_killed_run_goes_on_and_says_the_same(procedure: str, tmp_path: Path) -> None:
    plan = shipped("plans", procedure.split()[0])
    plan["parameters"] |= SHORT[procedure]
    path = tmp_path / "plan.yaml"
    path.write_text(yaml.safe_dump(plan), encoding="utf-8")
    parent = tmp_path / "runs"
    command = station_command("run", path, "--non-interactive", "--output", parent)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    began = time.monotonic()
    while finished(parent) < KILLED_AFTER[procedure]:
        assert process.poll() is None, "the run ended before it was killed"
        assert time.monotonic() - began < GIVES_UP_AFTER_S
        time.sleep(0.005)
    process.kill()
    process.wait()
    folder = only_run(parent)
    assert folder is not None
    done = list(RunFolder(folder).finished_units())
    raw = {file.name: file_hash(file) for file in (folder / "raw").iterdir()}

    outcome = resume(ResumeRequest(folder, quiet=True, report=False))
    assert outcome.document is not None, outcome.error
    assert "resumed" in {flag.code for flag in outcome.document.flags}
    assert {name: file_hash(folder / "raw" / name) for name in raw} == raw
    after = RunFolder(folder)
    assert all(after.finished_units()[unit].get("segment", 0) == 0 for unit in done)
    assert len(after.finished_units()) > len(done)

    whole = subprocess.run(
        station_command("run", path, "--non-interactive", "--output", tmp_path / "whole", "--json"),
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    reference = {(one["name"], one["axis"]): one for one in yaml.safe_load(whole.stdout)["results"]}
    for one in outcome.document.to_data()["results"]:
        other = reference[one["name"], one["axis"]]
        assert (one["value"] is None) == (other["value"] is None)
        if one["value"] is None or not one["standard_uncertainty"]:
            continue
        if one["name"] in ("residual_field", "K0", "Ki", "bias", "bias_repeatability"):
            continue  # what was nulled, mean temperature and switch-ons are those of each run
        u = math.hypot(one["standard_uncertainty"], other["standard_uncertainty"])
        assert abs(one["value"] - other["value"]) < AGREES * u, one["name"]
