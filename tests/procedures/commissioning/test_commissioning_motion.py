"""The table's part: healthy benches pass, a navigator stands in, a sensor upside down."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from campaigns.planted.commissioning import Plant, named, plants_of
from commissioning_parts import plan_of
from plan_runs import run_of, shipped_bench
from quick_yaml import dump_yaml
from short_forms import read_bench_at

from procedures.commissioning import motion


def short_plan() -> dict[str, Any]:
    """Return the part's plan without whole turns, of which the naming needs none."""
    plan = plan_of("motion")
    plan["parameters"]["motion"] |= {"whole_turns": False, "rest": "2 s"}
    return plan


@pytest.mark.campaign
@pytest.mark.parametrize("bench", ["sim", "sim-alternate"])
def test_a_healthy_table_raises_no_alarm(tmp_path: Path, bench: str) -> None:
    outcome = run_of(tmp_path / bench, plan_of("motion"), shipped_bench(bench))
    assert named(outcome) == set()
    assert outcome.exit_code == 0
    assert outcome.document is not None
    results = outcome.document.to_data()["results"]
    assert {one["axis"] for one in results if one["name"] == "axis_lean"} == {
        "outer",
        "middle",
        "inner",
    }
    for one in results:
        nominal = 1.0 if one["name"].endswith("_ratio") else 0.0
        assert abs(one["value"] - nominal) <= 3.5 * one["standard_uncertainty"], one


def with_a_navigator_alone(bench: dict[str, Any]) -> dict[str, Any]:
    """Return a bench without its nine-axis sensor."""
    del bench["instruments"]["imu"]
    bench["interlocks"] = [one for one in bench["interlocks"] if one["when"]["instrument"] != "imu"]
    return bench


@pytest.mark.parametrize(
    "plant", [None, *plants_of("motion")[:3]], ids=lambda one: one.name if one else "none"
)
def test_a_navigator_stands_in_for_a_sensor(tmp_path: Path, plant: Plant | None) -> None:
    bench = with_a_navigator_alone(shipped_bench("sim"))
    causes = set() if plant is None else {plant.plant(bench, random.Random(4))}
    path = tmp_path / "bench.yaml"
    path.write_text(dump_yaml(bench), encoding="utf-8")
    assert list(motion.PART.fits(read_bench_at(path))) == ["parameters.motion.device=navigator"]
    plan = short_plan()
    plan["parameters"]["motion"]["device"] = "navigator"
    assert named(run_of(tmp_path / "run", plan, bench)) == causes


@pytest.mark.campaign
def test_a_sensor_that_stands_upside_down_is_named_alone(tmp_path: Path) -> None:
    bench = shipped_bench()
    bench["instruments"]["turntable"]["simulator"]["axis_3"]["encoder_offset"] = "180 deg"
    outcome = run_of(tmp_path / "run", short_plan(), bench)
    assert named(outcome) == {("sensor-upside-down", None)}
    assert outcome.exit_code == 1


def test_the_sensor_has_its_settings_back_before_it_is_switched_off(tmp_path: Path) -> None:
    outcome = run_of(tmp_path / "run", short_plan(), shipped_bench())
    events = (outcome.folder / "events.jsonl").read_text(encoding="utf-8")
    assert '"instrument-settings"' in events
    assert '"settings-stay"' not in events
