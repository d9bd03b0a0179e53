"""Rotary stage and laser gyro on the simulated benches: healthy ones, and what is not decided."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from campaigns.planted.commissioning import named
from commissioning_parts import EARTH, whole_plan_of
from plan_runs import run_of, shipped_bench


def short_plan(part: str, earth: Any = EARTH, **changes: Any) -> dict[str, Any]:
    """Return a part's plan with a short record, the earth's rate stated for the gyro."""
    plan = whole_plan_of(part)
    plan["parameters"]["earth"] = earth
    own = {"readings": 3, "nplc": 1} if part == "stage" else {"record": "300 s"}
    plan["parameters"][part] |= own | changes
    return plan


@pytest.mark.parametrize("part", ["stage", "gyro"])
def test_a_healthy_bench_raises_no_alarm(tmp_path: Path, part: str) -> None:
    outcome = run_of(tmp_path / "run", short_plan(part), shipped_bench())
    assert named(outcome) == set()
    assert outcome.exit_code == 0


@pytest.mark.campaign
def test_a_bias_that_hides_one_percent_decides_no_pulse_weight(tmp_path: Path) -> None:
    vague = {**EARTH, "bias": "0.1 deg/h"}
    outcome = run_of(tmp_path / "run", short_plan("gyro", earth=vague), shipped_bench())
    assert named(outcome) == {("pulse-weight-undecided", None)}


def test_without_an_input_axis_nothing_is_said_of_the_pulse_weight(tmp_path: Path) -> None:
    plan = short_plan("gyro", earth=None, warm_up="0 s", record="20 s")
    outcome = run_of(tmp_path / "run", plan, shipped_bench("sim-alternate"))
    assert named(outcome) == set()
    assert outcome.document is not None
    results = {one["name"]: one for one in outcome.document.to_data()["results"]}
    assert results["pulse_weight_ratio"]["value"] is None
    assert outcome.document.verdict == "inconclusive"
    assert outcome.exit_code == 6


@pytest.mark.campaign
def test_a_gyro_that_feels_nothing_of_the_earth_fails(tmp_path: Path) -> None:
    bench = shipped_bench()
    bench["simulation"]["gyro"]["input_axis"] = {"azimuth": "90 deg", "elevation": "0 deg"}
    outcome = run_of(tmp_path / "run", short_plan("gyro"), bench)
    assert named(outcome) == {("gyro-without-pulses", None)}
    assert outcome.exit_code == 1


def test_an_accelerometer_along_another_axis_is_one_cause(tmp_path: Path) -> None:
    bench = shipped_bench()
    bench["instruments"]["rotary_stage"]["simulator"]["encoder_offset"] = "90 deg"
    outcome = run_of(tmp_path / "run", short_plan("stage"), bench)
    assert named(outcome) == {("stage-zero-off", None)}
    assert outcome.exit_code == 1
