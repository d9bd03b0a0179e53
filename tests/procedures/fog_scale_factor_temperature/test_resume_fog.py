"""A run of the temperature procedure that ended behind its ramp, and goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from short_forms import SHORT_FORMS

from station.cli.validating import read_bench_named
from station.files.lookup import PLANS, find
from station.files.plan import read_plan
from station.procedure import Procedures
from station.record.folder import RunFolder, RunRecord
from station.runner.execute import Request, execute
from station.runner.resuming import ResumeRequest, resume

PLAN = "fog-scale-factor-temperature"
HIGHEST_DEGC = 23.7
"""The controller keeps it in single precision, and says 23.7000008 degC."""


def test_it_goes_on_though_the_set_point_reads_back_a_digit_beyond_the_plans_range(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended_behind: list[float] = []

    def one_turn(record: RunRecord, unit: str, **details: Any) -> None:
        finish_unit(record, unit, **details)
        stands_degC = details.get("stands", {}).get("set_point_degC", 0.0)
        if stands_degC > HIGHEST_DEGC:
            ended_behind.append(stands_degC)
            raise OSError(28, "No space left on device")

    finish_unit = RunRecord.finish_unit
    other = (f"parameters.temperature_range=[22 degC, {HIGHEST_DEGC} degC]",)
    short = [one for one in SHORT_FORMS[PLAN] if not one.startswith("parameters.temperature_range")]
    plan = read_plan(find(PLANS, PLAN), Procedures(), (*short, *other))
    with monkeypatch.context() as patched:
        patched.setattr(RunRecord, "finish_unit", one_turn)
        ended = execute(Request(plan, read_bench_named("sim"), tmp_path, quiet=True, report=False))
    assert ended.exit_code == 3
    assert ended_behind
    outcome = resume(ResumeRequest(ended.folder, quiet=True, report=False))
    assert outcome.error is None
    assert "end of ramp" in RunFolder(ended.folder).finished_units()
