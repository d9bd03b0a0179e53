"""A run of the temperature procedure that ended behind its ramp, and goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from short_forms import SHORT_FORMS

from station.cli.validating import read_bench_named
from station.files.lookup import PLANS, find
from station.files.plan import read_plan
from station.method.motion import AxisAtRate, TemperatureRamp
from station.method.run import EarlierProgress
from station.procedure import Procedures, procedure_of
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


def test_what_is_left_of_a_run_leaves_out_the_sets_of_turns_that_are_made() -> None:
    procedure, plan = procedure_of(PLAN), read_plan(find(PLANS, PLAN), Procedures())
    whole = procedure.walk(plan.parameters)
    stands = {"gyro_degC": 10.0, "own_degC": 10.0, "set_point_degC": 8.0}
    made = [f"ramp {number} {axis} {k}" for number in range(21) for axis in "xyz" for k in (0, 1)]
    made = made[:-1]  # the last pair is made again
    finished = {unit: {"stands": stands} for unit in made}
    left = procedure.walk(plan.parameters, EarlierProgress(finished))
    turns = [act.command for act in left.acts if isinstance(act.command, AxisAtRate)]
    assert [act.step for act in left.acts if act.command in turns] == ["2"] * 2 + ["4"] * 6
    soak_s = plan.parameters.soak_s
    assert left.duration("1").expected_s < whole.duration("1").expected_s - soak_s + 3600.0
    interval_s = plan.parameters.set_interval_s
    assert left.duration("2").expected_s == whole.duration("2").expected_s - 20 * interval_s
    assert left.duration("2").shortest_s == pytest.approx(whole.duration("2").shortest_s / 3.0)
    behind = procedure.walk(plan.parameters, EarlierProgress({**finished, "end of ramp": {}}))
    assert behind.duration("2").longest_s == 0.0
    ramps = [command for command in behind.commands if isinstance(command, TemperatureRamp)]
    assert [ramp.temperature_degC for ramp in ramps] == [-40.0]
