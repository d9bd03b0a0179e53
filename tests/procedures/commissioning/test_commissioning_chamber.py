"""The chamber's part on the simulated benches: healthy ones pass, all in the air are named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.planted.commissioning import named
from commissioning_parts import plan_of
from plan_runs import run_of, shipped_bench

from procedures.commissioning.chamber import lag_of


def short_plan() -> dict[str, Any]:
    plan = plan_of("chamber")
    plan["parameters"]["chamber"] |= {"before": "15 min", "after": "40 min"}
    return plan


@pytest.mark.campaign
@pytest.mark.parametrize("bench", ["sim", "sim-alternate"])
def test_a_healthy_chamber_raises_no_alarm(tmp_path: Path, bench: str) -> None:
    outcome = run_of(tmp_path / bench, short_plan(), shipped_bench(bench))
    assert named(outcome) == set()
    assert outcome.exit_code == 0
    assert outcome.document is not None
    gains = [
        one for one in outcome.document.to_data()["results"] if one["name"] == "thermometer_gain"
    ]
    assert {one["axis"] for one in gains} == {"x", "y", "z"}
    assert all(abs(one["value"] - 1.0) < 0.05 for one in gains)


def test_a_lag_of_a_ramp_stays_behind_by_its_time_constant() -> None:
    time_s = np.arange(0.0, 1000.0, 10.0)
    behind = 0.01 * time_s - lag_of(time_s, 0.01 * time_s, 50.0)
    assert behind[-1] == pytest.approx(0.5, rel=1e-6)


def test_thermometers_that_are_all_in_the_air_are_named(tmp_path: Path) -> None:
    bench = shipped_bench("sim")
    bench["simulation"]["fog"]["gyros"]["sensor_wiring"] = dict.fromkeys("xyz", "air")
    outcome = run_of(tmp_path / "run", short_plan(), bench)
    assert named(outcome) == {("thermometer-wrong-channel", axis) for axis in "xyz"}
    assert outcome.exit_code == 1
