"""The pick-up part on the simulated benches: healthy ones pass, pick-up is named with its size."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.planted.commissioning import named, plants_of
from commissioning_parts import plan_of
from our_drivers import bench_from
from plan_runs import run_of, shipped_bench

from procedures.commissioning.pick_up import PART, PickUpDataset, PickUpReadings, analyse


def short_plan() -> dict[str, Any]:
    plan = plan_of("pick_up")
    plan["parameters"]["pick_up"] |= {"record": "20 s", "every": "1 s"}
    return plan


def test_healthy_leads_raise_no_alarm(tmp_path: Path) -> None:
    outcome = run_of(tmp_path / "run", short_plan(), shipped_bench())
    assert named(outcome) == set()
    assert outcome.exit_code == 0


@pytest.mark.parametrize("seed", [1])
def test_pick_up_is_named_with_its_size(tmp_path: Path, seed: int) -> None:
    bench, rng = shipped_bench(), random.Random(seed)
    bench["simulation"]["seed"] = seed
    (plant,) = plants_of("pick_up")
    cause = plant.plant(bench, rng)
    outcome = run_of(tmp_path / "run", short_plan(), bench)
    assert named(outcome) == {cause}
    assert outcome.exit_code == 1
    assert outcome.document is not None
    planted_uV = float(bench["instruments"]["multimeter"]["simulator"]["pick_up"].split()[0])
    lines = [one for one in outcome.document.to_data()["results"] if one["name"] == "pick_up"]
    assert len(lines) == 3
    for one in lines:
        setting = bench["instruments"][f"coil_supply.{one['axis']}"]["settings"]["coil_constant"]
        peak_A = 0.5 / float(setting.split()[0])
        assert one["value"] == pytest.approx(planted_uV * peak_A, rel=0.01)


def test_a_bench_without_a_voltmeter_has_no_such_part() -> None:
    for name in ("sim", "sim-alternate"):
        bench = shipped_bench(name)
        assert PART.is_possible(bench_from(bench))
        del bench["instruments"]["multimeter"]
        assert not PART.is_possible(bench_from(bench))


def test_a_line_that_is_there_without_a_drive_is_not_the_coils() -> None:
    time_s = np.arange(0.0, 30.0, 0.5)
    line = PickUpReadings(
        time_s, 20.0 * np.sin(2 * np.pi * 0.1 * time_s) + 0.1 * np.cos(time_s), 0.1
    )
    found = analyse(PickUpDataset(dict.fromkeys(("off", "x", "y", "z"), line)))
    assert [flag.code for flag in found.flags] == ["line-at-drive-frequency"]


def test_readings_beyond_the_range_are_named_and_not_fitted(tmp_path: Path) -> None:
    bench = shipped_bench()
    bench["instruments"]["multimeter"]["simulator"]["pick_up"] = "300 mV"
    outcome = run_of(tmp_path / "run", short_plan(), bench)
    assert named(outcome) == {("pick-up-beyond-range", None)}
    assert outcome.exit_code == 1
