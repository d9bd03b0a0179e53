"""The plan of a nine-axis calibration: whole turns by construction, bad input in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from procedures.nine_axis_calibration.outlook import check, expectation, outlook
from procedures.nine_axis_calibration.parameters import NineAxisParameters
from station.files.lookup import PLANS, find
from station.files.plan import read_plan
from station.method.run import EarlierProgress
from station.procedure import Procedures, procedure_of

PLAN = find(PLANS, "nine-axis-calibration")
GIVEN = {"latitude": "39.9 deg"}


def parameters(**given: Any) -> NineAxisParameters:
    return NineAxisParameters.model_validate({**GIVEN, **given})


def said(**given: Any) -> str:
    with pytest.raises(ValidationError) as caught:
        parameters(**given)
    return str(caught.value)


def test_a_plan_of_the_method_has_no_fault() -> None:
    plan = read_plan(PLAN, Procedures())
    assert plan.parameters.turns_at(100.0) == 1
    assert plan.limits["bias", "Z"].max_abs == 1.0
    assert any("scale factor: u = " in line for line in outlook(plan.parameters))


def test_every_record_is_whole_turns_by_construction() -> None:
    for one in parameters().all_turns:
        assert one.turns * 360 == pytest.approx(abs(one.rate_deg_per_s) * one.dwell_s)
        assert one.dwell_s == pytest.approx(360.0)
    times = [one.dwell_s for one in parameters(dwell="efficient", turns=2).all_turns[:10:2]]
    assert times == pytest.approx([720.0, 144.0, 72.0, 14.4, 7.2])


def test_units_of_work_are_positions_and_each_axis_rate_and_sense() -> None:
    units = parameters(flip=True).units
    assert len(units) == 6 + 30 == len(set(units))
    assert units[:3] == ("position 1", "position 4", "position 2")
    assert units[6:8] == ("X +1 deg/s", "X -1 deg/s")
    assert parameters(positions=[3, 1, 2]).all_positions == (3, 1, 2)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"rates": ["1 deg/s", "5 deg/s", "10 deg/s", "50 deg/s"]}, "needs N > 4"),
        ({"rates": ["1 deg/s"] * 5}, "1 deg/s stands twice"),
        ({"range": "90 deg/s"}, "100 deg/s of rates is not below the gyro's range, 90 deg/s"),
        ({"dwell_time": "60 s"}, "60 s at 1 deg/s are 0.1667 turns, not a whole number"),
        ({"dwell_time": "60 s"}, "360 s would be whole at every rate"),
        ({"dwell": "efficient", "dwell_time": "360 s"}, "give turns"),
        ({"turns": 2}, "give dwell_time"),
        ({"positions": [1, 3]}, "position 2 is skipped"),
        ({"positions": [1, 2, 3, 3]}, "3 stands twice"),
        ({"latitude": "95 deg"}, "less than or equal to 89"),
    ],
)
def test_bad_input_is_said_in_a_sentence(given: dict[str, Any], sentence: str) -> None:
    assert sentence in said(**given)


def test_a_plan_without_latitude_is_refused() -> None:
    with pytest.raises(ValidationError, match="latitude"):
        NineAxisParameters.model_validate({})


def test_what_to_expect_gets_better_with_time_and_with_a_flip() -> None:
    short, long = expectation(parameters()), expectation(parameters(static_time="40 min"))
    assert long.bias_deg_per_h[0] == pytest.approx(short.bias_deg_per_h[0] / 2, rel=0.1)
    assert long.published_bias_deg_per_h > 0.8 * short.published_bias_deg_per_h
    assert expectation(parameters(flip=True)).bias_deg_per_h[0] < 0.8 * short.bias_deg_per_h[0]
    assert short.published_scale_factor / short.scale_factor == pytest.approx(23.0, abs=0.5)
    quick = expectation(parameters(dwell="efficient"))
    assert quick.published_scale_factor > short.published_scale_factor


def test_the_bench_may_know_the_gyros_range(tmp_path: Path) -> None:
    from interlock_helpers import bench_from

    text = (
        "bench: 1\nname: small\nsafe_state: []\ninstruments:\n"
        "  imu: {driver: operator-power, limits: {rate: 80 deg/s}}\n"
    )
    problems = list(check(parameters(), bench_from(text)))
    assert [one.what.split(" is ")[0] for one in problems] == ["100 deg/s"]


def test_what_is_left_of_a_run_leaves_out_the_units_that_are_finished() -> None:
    plan = read_plan(PLAN, Procedures())
    procedure, units = procedure_of(plan.procedure), plan.parameters.units
    whole = procedure.walk(plan.parameters)
    assert whole.units == units
    finished = {unit: dict[str, Any]() for unit in units}
    made = {unit: finished[unit] for unit in units[:14]}
    left = procedure.walk(plan.parameters, EarlierProgress(made))
    assert left.units == units[14:]
    assert left.duration("1b").longest_s == 0.0
    words = [command.text for command in left.commands if hasattr(command, "text")]
    assert not any(word.startswith("X") for word in words)  # its ten records are made
    behind = procedure.walk(plan.parameters, EarlierProgress(finished))
    assert behind.duration().longest_s == 0.0
