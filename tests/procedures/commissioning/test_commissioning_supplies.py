"""The supplies' part on the simulated benches: healthy ones pass, each planted fault is named."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from commissioning_parts import plan_of
from plan_runs import run_of, shipped_bench, shipped_plan
from plants import Plant, named
from plants_supplies import PLANTS

from procedures.commissioning.supplies import limits


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


@pytest.mark.parametrize(("seed", "bench"), [(1, "sim"), (2, "sim-alternate")])
@pytest.mark.parametrize("plant", PLANTS, ids=lambda one: one.name)
def test_a_planted_fault_is_named_alone(
    tmp_path: Path, plant: Plant, seed: int, bench: str
) -> None:
    data, rng = shipped_bench(bench), random.Random(seed)
    data["simulation"]["seed"] = seed
    cause = plant.plant(data, rng)
    plan = plan_of("supplies")
    plan["parameters"]["supplies"] = {"record": "2 s", "turn_probe": bench == "sim-alternate"}
    outcome = run_of(tmp_path / "run", plan, data)
    assert named(outcome) == {cause}
    assert outcome.exit_code == 1


def test_the_shipped_plan_states_the_limits_of_the_naming() -> None:
    stated = shipped_plan("commissioning")["limits"]
    assert stated["own_limit_ratio"] == {"max": limits.OWN_LIMIT}
    assert stated["field_after_cut"]["max"] == f"{limits.FIELD_AFTER_CUT_MT:g} mT"
