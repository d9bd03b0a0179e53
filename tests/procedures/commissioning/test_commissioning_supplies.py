"""The supplies' part on the simulated benches: healthy ones pass, limits are the plan's."""

from __future__ import annotations

from pathlib import Path

import pytest
from campaigns.planted.commissioning import named
from commissioning_parts import plan_of
from plan_runs import run_of, shipped_bench


@pytest.mark.parametrize(("bench", "turned"), [("sim", False), ("sim-alternate", True)])
def test_healthy_supplies_raise_no_alarm(tmp_path: Path, bench: str, turned: bool) -> None:
    plan = plan_of("supplies")
    plan["parameters"]["supplies"] = {"record": "2 s", "turn_probe": turned}
    outcome = run_of(tmp_path / bench, plan, shipped_bench(bench))
    assert named(outcome) == set()
    assert outcome.exit_code == 0
    assert outcome.document is not None
    for one in outcome.document.to_data()["results"]:
        assert one["verdict"] == "pass", one
        if one["name"] == "own_limit_ratio":  # refused, so that it stayed at zero
            assert abs(one["value"]) < 0.1
